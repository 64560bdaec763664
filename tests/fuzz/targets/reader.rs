//! One reader, which the environment variable `READER` names, under libFuzzer.
#![no_main]

use std::sync::OnceLock;

use pellucid_tests::readers::{READERS, Reader};

/// The reader that is run.
fn reader() -> &'static Reader {
    static READER: OnceLock<&Reader> = OnceLock::new();
    READER.get_or_init(|| {
        let name = std::env::var("READER").unwrap_or_default();
        READERS.iter().find(|reader| reader.name == name).unwrap_or_else(|| {
            let known: Vec<_> = READERS.iter().map(|reader| reader.name).collect();
            eprintln!("READER={name:?} is none of {}", known.join(", "));
            std::process::exit(2)
        })
    })
}

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    // Refusals are as good as anything else here.
    let _ = (reader().read)(bytes);
});
