//! WebP textures in glTF.

use serde_json::json;

use crate::glb::*;

#[test]
fn webp_textures_are_read_and_come_before_their_fallback() {
    let texels = [[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255]];
    let webp = encode(2, 2, &texels, image::ImageFormat::WebP);
    let expected = textured_square(&four_colors()).model();
    let mut glb = textured_square(&webp);
    assert_eq!(glb.model().textures(), expected.textures());
    *glb.at("/textures/0") = json!({"extensions": {"EXT_texture_webp": {"source": 0}}});
    glb.push("extensionsRequired", "EXT_texture_webp".into());
    assert_eq!(glb.model().textures(), expected.textures());
    let other = glb.view(&png(1, 1, &[[9, 9, 9]]));
    let fallback = glb.push("images", json!({"bufferView": other}));
    glb.at("/textures/0")["source"] = fallback.into();
    assert_eq!(glb.model().textures(), expected.textures());
    let damaged = textured_square(&webp[..webp.len() / 2]).import().unwrap_err().to_string();
    assert!(damaged.contains("image 0 \"skin\""), "{damaged}");
    *glb.at("/textures/0") = json!({"extensions": {"EXT_texture_webp": {"source": "x"}, "ACME": 3}});
    let none = glb.import().unwrap_err().to_string();
    assert!(none.contains("EXT_texture_webp"), "{none}");
}
