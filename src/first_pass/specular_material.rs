//! What materials do with specular light.

use super::lobe_table::LobeTable;
use crate::material::{AlbedoTable, SampledMaterial, Transmission};
use std::collections::HashMap;
use std::sync::Arc;

/// What a material does with specular light.
#[derive(Clone, Debug)]
pub struct SpecularMaterial {
    /// m.
    pub m: f64,
    /// m².
    pub m2: f32,
    /// s F against the cosine.
    pub reflect: LobeTable,
    /// s F met from inside a solid.
    pub reflect_inside: Option<LobeTable>,
    /// Transmittance against the cosine outside.
    pub transmit: Option<LobeTable>,
    /// n² of a solid, else 1.
    pub n2: f32,
    /// Absorption coefficient inside a solid, 1/m, `[W]`.
    pub absorption: Vec<f32>,
    /// Directional albedo with F = 1.
    pub albedo: Arc<AlbedoTable>,
}

/// What the lobes of a material depend on: the bits of m and of n², whether there is transmission, and the tables of
/// a solid.
pub type Shape = (u64, u32, bool, Option<[Option<u64>; 3]>);

/// Whether a shape is that of a rough reflection and nothing else.
pub fn is_rough(shape: &Shape) -> bool {
    let m = f64::from_bits(shape.0);
    (m * m) as f32 > 0.0 && !shape.2
}

impl SpecularMaterial {
    /// What lobes depend on.
    pub fn shape(&self) -> Shape {
        // What a solid reflects and refracts is scaled together, by how much of each there is.
        let tables = [Some(&self.reflect), self.reflect_inside.as_ref(), self.transmit.as_ref()];
        let tables = self.reflect_inside.is_some().then(|| tables.map(|t| t.map(LobeTable::fingerprint)));
        (self.m.to_bits(), self.n2.to_bits(), self.transmit.is_some(), tables)
    }

    /// Of each of some materials, `None` where there is nothing specular about it. Albedos, which depend on m alone, are
    /// used again where one `before` has them.
    pub fn all(materials: &[SampledMaterial], before: &[Option<Self>]) -> Vec<Option<Self>> {
        let mut albedos: HashMap<u64, Arc<AlbedoTable>> =
            before.iter().flatten().map(|of| (of.m.to_bits(), of.albedo.clone())).collect();
        let of = |material: &SampledMaterial| {
            let m = material.m;
            let mut albedo =
                || albedos.entry(m.to_bits()).or_insert_with(|| Arc::new(AlbedoTable::new(m))).clone();
            material.is_specular().then(|| Self::new(material, albedo()))
        };
        materials.iter().map(of).collect()
    }

    fn new(material: &SampledMaterial, albedo: Arc<AlbedoTable>) -> Self {
        let share = material.s as f32;
        let mut specular = SpecularMaterial {
            m: material.m,
            m2: (material.m * material.m) as f32,
            reflect: LobeTable::new(&material.reflect, share, false),
            reflect_inside: None,
            transmit: None,
            n2: 1.0,
            absorption: Vec::new(),
            albedo,
        };
        match &material.transmission {
            None => {}
            Some(Transmission::Pane { transmit }) => {
                specular.transmit = Some(LobeTable::new(transmit, share, false));
            }
            Some(Transmission::Solid { n, inside, absorption }) => {
                specular.transmit = Some(LobeTable::new(&material.reflect, share, true));
                specular.reflect_inside = Some(LobeTable::new(inside, share, false));
                specular.n2 = (n * n) as f32;
                specular.absorption = absorption.clone();
            }
        }
        specular
    }
}
