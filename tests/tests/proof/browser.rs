//! The page in headless Chromium, driven as a person would.

use serde_json::{Value, json};

use crate::lights::LIT;
use crate::preview::{of_a_ball, written};
use crate::webdriver::Browser;
use crate::{PRINT, Print, plain, shown};

const RIGHT: &str = "\u{e014}";
const ENTER: &str = "\u{e007}";

/// Mean colour, and the colour of the middle, of what the view shows.
const LOOK: &str = "
    const view = document.getElementById('view');
    document.documentElement.viewer.draw();
    const copy = document.createElement('canvas');
    [copy.width, copy.height] = [view.width, view.height];
    const context = copy.getContext('2d');
    context.drawImage(view, 0, 0);
    const { data } = context.getImageData(0, 0, copy.width, copy.height);
    const sum = [0, 0, 0];
    for (let i = 0; i < data.length; i++) if (i % 4 < 3) sum[i % 4] += data[i] / (data.length / 4);
    const middle = 4 * (Math.floor(copy.height / 2) * copy.width + Math.floor(copy.width / 2));
    return { mean: sum, middle: [...data.slice(middle, middle + 3)] };";

fn look(browser: &Browser) -> Value {
    browser.run(LOOK)
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

fn apart(a: &Value, b: &Value) -> f64 {
    numbers(a).iter().zip(numbers(b)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// The text of a field in what was picked.
fn picked(browser: &Browser, field: &str) -> String {
    let script = format!("return document.querySelector('#pick [data-field={field}] td').textContent");
    browser.run(&script).as_str().unwrap().to_owned()
}

#[test]
fn the_page_works_in_a_browser() {
    let Some(browser) = Browser::start() else {
        let required = std::env::var_os("PELLUCID_BROWSER").is_some_and(|v| v == "required");
        assert!(
            !required,
            "PELLUCID_BROWSER says that there is a browser, but Chromium or ChromeDriver is missing"
        );
        eprintln!("SKIPPED: the page in a browser; install Chromium and ChromeDriver to have it tested");
        return;
    };
    let print = &*PRINT;
    browser.open(&print.file("proof.html"));
    browser.wait_for("document.documentElement.dataset.ready");
    let ready = browser.run("return Number(document.documentElement.dataset.ready)");
    println!("the page was ready after {ready} ms");
    views_switch(&browser);
    a_pick_reads_the_fields(&browser, print);
    paper_white_is_shown(&browser, print);
    two_views_share_the_stage(&browser);
    distance_blurs(&browser);
    layers_are_the_images(&browser, print);
    charts_have_the_reports_figures(&browser, print);
    findings_show_their_place(&browser, print);
    themes_differ(&browser);
    a_phone_has_room(&browser);
    nothing_was_asked_for(&browser, print);
    a_preview_opens(&browser);
    lights_can_be_chosen(&browser);
}

fn lights_can_be_chosen(browser: &Browser) {
    browser.open(&LIT.file("proof.html"));
    browser.wait_for("document.documentElement.dataset.ready");
    let shown =
        |field: &str| browser.run(&format!("return !document.querySelector('[data-field={field}]').hidden"));
    assert_eq!((shown("inconstancy"), shown("error")), (json!(false), json!(true)));
    let first = look(browser);
    browser.click("[data-field=error]");
    browser.keys("#light", "A");
    // Errors are the first light's: what is shown is the print again.
    assert_eq!(browser.run("return document.documentElement.viewer.left"), "refined");
    assert_eq!((shown("inconstancy"), shown("error")), (json!(true), json!(false)));
    assert!(apart(&look(browser)["mean"], &first["mean"]) > 0.05, "the same under another light");
    browser.click("[data-field=inconstancy]");
    browser.keys("#view", ENTER);
    assert!(picked(browser, "inconstancy").ends_with("dE2000"));
    browser.keys("#light", "D65");
    assert_eq!(look(browser)["mean"], first["mean"]);
}

/// The print's own white beside a perfect one: seen, read off, and gone again.
fn paper_white_is_shown(browser: &Browser, print: &Print) {
    browser.click("[data-field=target]");
    browser.keys("#view", ENTER);
    let (before, read) = (look(browser), picked(browser, "target"));
    browser.click("#paper");
    let shown = picked(browser, "target");
    assert!(apart(&look(browser)["mean"], &before["mean"]) > 1.0);
    for c in 0..3 {
        let byte = |text: &str| u8::from_str_radix(&text[1 + 2 * c..3 + 2 * c], 16).unwrap();
        let linear = pellucid::color::space::srgb_decode(f64::from(byte(&read)) / 255.0);
        let white = print.figure(&format!("report.media_white.{c}"));
        let wanted = pellucid::color::space::srgb_encode_u8(linear * white);
        assert!(byte(&shown).abs_diff(wanted) <= 1, "{read} {shown} {wanted}");
    }
    browser.click("#paper");
    assert_eq!(look(browser), before);
}

/// A preview has views and findings, and no slices.
fn a_preview_opens(browser: &Browser) {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("preview");
    written(&of_a_ball(2.0), &out);
    browser.open(&out.join("preview.html"));
    browser.wait_for("document.documentElement.dataset.ready");
    assert_eq!(browser.run("return document.documentElement.viewer.left"), "unrefined");
    let before = look(browser);
    browser.click("[data-show=cross_talk]");
    assert!(apart(&look(browser)["mean"], &before["mean"]) > 0.1);
    assert_eq!(browser.run("return document.getElementById('slice')"), Value::Null);
    let mut complaints = browser.log("browser");
    complaints.retain(|entry| entry["source"] != "rendering");
    assert!(complaints.is_empty(), "{complaints:?}");
}

fn views_switch(browser: &Browser) {
    let mut seen: Vec<Value> = Vec::new();
    for field in ["target", "unrefined", "refined", "error", "thickness", "gamut", "cross_talk"] {
        browser.click(&format!("[data-field={field}]"));
        let now = look(browser);
        assert!(
            seen.iter().all(|s| apart(&s["mean"], &now["mean"]) > 0.1),
            "{field} looks like another: {now}"
        );
        let pressed = browser.run("return document.querySelector('[aria-pressed=true]').dataset.field");
        assert_eq!(pressed, field);
        seen.push(now);
    }
    browser.click("[data-field=target]");
    assert_eq!(look(browser), seen[0], "the same again");
    for turn in [RIGHT, "+"] {
        let before = look(browser);
        browser.keys("#view", turn);
        assert!(apart(&look(browser)["mean"], &before["mean"]) > 0.01, "{turn:?} moves the print");
    }
    browser.keys("#view", "0");
    assert_eq!(look(browser), seen[0], "0 brings everything back");
}

/// What is read at a place is what the labels have there.
fn a_pick_reads_the_fields(browser: &Browser, print: &Print) {
    browser.keys("#view", ENTER);
    let target = picked(browser, "target");
    let middle = numbers(&look(browser)["middle"]);
    let channel = |i: usize| f64::from(u8::from_str_radix(&target[1 + 2 * i..3 + 2 * i], 16).unwrap());
    for (i, seen) in middle.iter().enumerate() {
        assert!((channel(i) - seen).abs() <= 12.0, "{target} is read and {middle:?} seen");
    }
    let place = browser.run("const v = document.documentElement.viewer; return [0, 1, 2].map((a) => v.surface.positions[3 * v.marked + a])");
    let place = numbers(&place);
    let surface = print.prepared.aimed.object.surface();
    let distance = |point: u32| {
        let p = surface.position_mm(point);
        (0..3).map(|a| (p[a] - place[a]).powi(2)).sum::<f64>()
    };
    let near: Vec<u32> = (0..surface.len() as u32).filter(|&p| distance(p) < 0.1f64.powi(2)).collect();
    assert!(!near.is_empty());
    let range = |value: &dyn Fn(usize) -> f64| {
        let values = near.iter().map(|&p| value(p as usize));
        values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
    };
    let number = |field: &str| -> f64 {
        picked(browser, field).trim_start_matches("≥ ").split(' ').next().unwrap().parse().unwrap()
    };
    let [low, high] = range(&|p| print.prepared.judged.error_parts[1][p].iter().map(|&v| f64::from(v)).sum());
    let error = number("error");
    assert!((low - 0.2..=high + 0.2).contains(&error), "{error}, {low} to {high} about there");
    let [low, high] = range(&|p| f64::from(print.prepared.aimed.thickness_mm[p]));
    let thickness = number("thickness");
    assert!((low - 0.1..=high + 0.1).contains(&thickness), "{thickness}, {low} to {high} about there");
    for c in 0..3 {
        let encoded = |v: f32| f64::from(pellucid::color::space::srgb_encode_u8(f64::from(v)));
        let [low, high] = range(&|p| encoded(print.prepared.aimed.target[p][c]));
        assert!((low - 1.0..=high + 1.0).contains(&channel(c)), "{target}, {low} to {high} about there");
    }
}

fn two_views_share_the_stage(browser: &Browser) {
    let alone = look(browser);
    browser.keys("#compare", "Thickness");
    browser.wait_for("!document.getElementById('divider').hidden");
    let both = look(browser);
    assert!(apart(&alone["mean"], &both["mean"]) > 1.0);
    browser.keys("#divider", "\u{e010}");
    assert_eq!(look(browser)["mean"], alone["mean"], "the divider at the end leaves one view");
    browser.run(
        "const c = document.getElementById('compare'); c.value = ''; c.dispatchEvent(new Event('change'))",
    );
}

/// From afar the patches run together: the picture's contrast falls, its mean stays.
fn distance_blurs(browser: &Browser) {
    let sharp = look(browser);
    browser.run(
        "const d = document.getElementById('distance'); d.value = 3000; d.dispatchEvent(new Event('input'))",
    );
    let blurred = look(browser);
    assert!(apart(&sharp["middle"], &blurred["middle"]) > 2.0, "{sharp} {blurred}");
    assert!(apart(&sharp["mean"], &blurred["mean"]) < 12.0, "{sharp} {blurred}");
    browser.run(
        "const d = document.getElementById('distance'); d.value = 0; d.dispatchEvent(new Event('input'))",
    );
}

fn layers_are_the_images(browser: &Browser, print: &Print) {
    let last = browser.run("return Number(document.getElementById('layer').max)").as_u64().unwrap();
    assert_eq!(last + 1, print.figure("manifest.size.2") as u64, "all layers of a small print");
    for layer in [7, last / 2, last] {
        browser.run(&format!(
            "const s = document.getElementById('layer'); s.value = {layer}; s.dispatchEvent(new Event('input'))"
        ));
        browser.wait_for(&format!("document.getElementById('slice').dataset.layer == {layer}"));
        let shown = browser.run(
            "const c = document.getElementById('slice');
             return [...c.getContext('2d').getImageData(0, 0, c.width, c.height).data]",
        );
        let file = std::fs::File::open(print.file(&format!("slices/slice_{layer:05}.png"))).unwrap();
        let mut reader = png::Decoder::new(std::io::BufReader::new(file)).read_info().unwrap();
        let mut image = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut image).unwrap();
        let shown: Vec<u8> = shown.as_array().unwrap().iter().map(|v| v.as_u64().unwrap() as u8).collect();
        assert!(shown == image, "layer {layer}");
    }
    browser.click("#layer-down");
    browser.wait_for(&format!("document.getElementById('slice').dataset.layer == {}", last - 1));
}

fn charts_have_the_reports_figures(browser: &Browser, print: &Print) {
    let figures = browser.run(
        "return [...document.querySelectorAll('svg [data-from]')].map((e) => ({ ...e.dataset, text: e.textContent }))",
    );
    let figures = figures.as_array().unwrap();
    assert!(figures.len() > 5, "{figures:?}");
    for figure in figures {
        let field = |name: &str| figure[name].as_str().unwrap();
        let scale: f64 = field("scale").parse().unwrap();
        let wanted = shown(print.figure(field("from")) * scale, field("digits").parse().unwrap());
        let text = plain(field("text"));
        assert_eq!(text.split(' ').next().unwrap(), wanted, "{}", field("from"));
    }
}

fn findings_show_their_place(browser: &Browser, print: &Print) {
    browser.run("window.scrollTo(0, 1e6)");
    browser.click("[data-show^=class]");
    let state = browser.run(
        "const v = document.documentElement.viewer, { channels, quantity } = v.field('error');
         return { left: v.left, value: (channels[0][v.marked] / 255) * quantity.most }",
    );
    assert_eq!(state["left"], "error");
    let mean = print.figure("report.evaluation.refined.at_0_1_mm.raw.mean");
    assert!(
        state["value"].as_f64().unwrap() > mean,
        "{state} is no place where it is bad; the mean is {mean}"
    );
    assert_eq!(browser.run("return !document.getElementById('marker').hidden"), true);
}

fn themes_differ(browser: &Browser) {
    let paper = || browser.run("return getComputedStyle(document.body).backgroundColor");
    let prefer = |value: &str| {
        let features = json!({ "features": [{ "name": "prefers-color-scheme", "value": value }] });
        browser.devtools("Emulation.setEmulatedMedia", &features);
    };
    prefer("light");
    let light = paper();
    prefer("dark");
    browser.wait_for("document.documentElement.dataset.theme === 'dark'");
    assert_ne!(paper(), light);
    browser.keys("#theme", "light");
    assert_eq!(paper(), light, "the choice goes before the system's");
}

/// At 400 pixels nothing is cut off, and a finger turns the print and reads it.
fn a_phone_has_room(browser: &Browser) {
    let phone = json!({ "width": 400, "height": 800, "deviceScaleFactor": 2, "mobile": true });
    browser.devtools("Emulation.setDeviceMetricsOverride", &phone);
    browser.wait_for("window.innerWidth === 400 && document.documentElement.scrollWidth <= 400");
    let small = browser.run(
        "return [...document.querySelectorAll('button')].filter((b) => {
           const box = b.getBoundingClientRect();
           return box.width && (box.right > 400 || box.left < 0 || box.height < 24);
         }).map((b) => b.textContent)",
    );
    assert_eq!(small, json!([]), "buttons out of sight or too small for a finger");
    browser.click("[data-field=refined]");
    browser.keys("#view", "0");
    let before = browser.run("return document.documentElement.viewer.azimuth").as_f64().unwrap();
    browser.swipe("#view", [-40, 0], [60, 0]);
    let after = browser.run("return document.documentElement.viewer.azimuth").as_f64().unwrap();
    assert!((after - before).abs() > 10.0, "{before} {after}");
    browser.run("document.getElementById('pick').replaceChildren()");
    browser.swipe("#view", [0, 0], [0, 0]);
    assert!(picked(browser, "refined").starts_with('#'));
}

fn nothing_was_asked_for(browser: &Browser, print: &Print) {
    // How often the test reads pixels back is its own business.
    let mut complaints = browser.log("browser");
    complaints.retain(|entry| entry["source"] != "rendering");
    assert!(complaints.is_empty(), "{complaints:?}");
    let page = format!("file://{}", print.file("proof.html").display());
    let mut requests = 0;
    for entry in browser.log("performance") {
        let message: Value = serde_json::from_str(entry["message"].as_str().unwrap()).unwrap();
        let (method, of) = (&message["message"]["method"], &message["message"]["params"]);
        if method == "Network.requestWillBeSent" && of["documentURL"] == page.as_str() {
            let url = of["request"]["url"].as_str().unwrap();
            assert!(url == page || url.starts_with("data:"), "{url}");
            requests += 1;
        }
    }
    assert!(requests > 0, "at least the page itself was asked for");
}
