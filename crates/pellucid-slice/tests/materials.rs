//! The committed material table is the built-in one.

use pellucid_voxel::MaterialTable;

#[test]
fn the_committed_materials_equal_the_built_in_ones() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../datasets/materials/cmykw.json");
    let text = std::fs::read_to_string(path).unwrap();
    let table: MaterialTable = serde_json::from_str(&text).unwrap();
    assert_eq!(table, MaterialTable::cmykw());
}
