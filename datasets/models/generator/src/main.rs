//! Writes the models: `pellucid-models [--out DIR] [--render SHEET.png] [--picture NAME PICTURE.png]`.
#![forbid(unsafe_code)]

use std::error::Error;
use std::path::PathBuf;

use pellucid_models::{glb, models, render};

fn main() -> Result<(), Box<dyn Error>> {
    let mut out = PathBuf::from("datasets/models");
    let mut sheet = None;
    let mut picture = None;
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        let mut value = || args.next().ok_or(format!("{arg} needs a value"));
        match arg.as_str() {
            "--out" => out = value()?.into(),
            "--render" => sheet = Some(PathBuf::from(value()?)),
            "--picture" => picture = Some((value()?, PathBuf::from(value()?))),
            _ => return Err(format!("unknown argument {arg:?}; try --out, --render or --picture").into()),
        }
    }
    let models = models::all();
    if let Some((name, path)) = picture {
        let model = models.iter().find(|m| m.name == name).ok_or(format!("no model {name:?}"))?;
        std::fs::write(path, render::render(model, model.view, 24.0, 800).to_png()?)?;
        return Ok(());
    }
    for model in &models {
        let path = out.join(format!("{}.glb", model.name));
        let bytes = glb::to_glb(model)?;
        std::fs::write(&path, &bytes)?;
        println!("{} {} bytes, {} triangles", path.display(), bytes.len(), model.part.triangles.len());
    }
    if let Some(path) = sheet {
        std::fs::write(path, render::reduced(render::contact_sheet(&models, 240)).to_png()?)?;
    }
    Ok(())
}
