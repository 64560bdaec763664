//! What tells models apart.

use pellucid_core::Digest;

use crate::Model;

impl Model {
    /// Digest of geometry, colours and textures; names and notes do not count.
    pub fn digest(&self) -> Digest {
        let mut digest = Digest::new();
        for vertex in self.vertices() {
            vertex.position_m.iter().for_each(|v| digest.add(&v.to_le_bytes()));
            vertex.uv.iter().chain(&vertex.color).for_each(|v| digest.add(&v.to_le_bytes()));
        }
        for triangle in self.triangles() {
            triangle.vertices.iter().chain([&triangle.material]).for_each(|v| digest.add(&v.to_le_bytes()));
        }
        for material in self.materials() {
            material.factor.iter().for_each(|v| digest.add(&v.to_le_bytes()));
            digest.add(&material.texture.map_or(u64::MAX, u64::from).to_le_bytes());
        }
        for opacity in self.opacity() {
            let (texture, threshold) =
                opacity.map_or((u64::MAX, -1.0), |o| (o.texture.map_or(u64::MAX, u64::from), o.threshold));
            digest.add(&texture.to_le_bytes());
            digest.add(&threshold.to_le_bytes());
        }
        self.textures().iter().for_each(|texture| texture.add_to(&mut digest));
        digest
    }
}
