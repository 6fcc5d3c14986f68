//! The materials of glTF: metallic-roughness, and glass.

use super::buffers::{Buffers, Means, resource};
use super::dress::Described;
use super::gltf::{distinct, list};
use super::look::{Body, Look, Rgb, normal_reflectance};
use super::texture::{self, Mean};
use gltf::json::material::{AlphaMode, Material};
use gltf::json::validation::Checked;
use gltf::json::{Index, Root, Texture};
use std::collections::BTreeMap;
use std::path::Path;

/// Index of a body where none is given.
const INDEX: f64 = 1.5;
/// The largest luminance, cd/m².
const MOST: f64 = 1e12;

/// All materials of `root`, in its order, and what there is to say about them.
pub fn describe(root: &Root, buffers: &Buffers, path: &Path, place: usize) -> (Vec<Described>, Vec<String>) {
    let called = root.materials.iter().enumerate().map(|(i, material)| {
        material.name.clone().filter(|n| !n.is_empty()).unwrap_or_else(|| format!("material {i}"))
    });
    let names = distinct(called);
    let mut reader = Reader { root, buffers, path, means: Means::new(), kinds: BTreeMap::new() };
    let described = names
        .into_iter()
        .zip(&root.materials)
        .map(|(name, material)| {
            let look = reader.look(&name, material);
            Described { name, look, place, file: path.to_path_buf() }
        })
        .collect();
    let mut notes = list(reader.kinds, path);
    let mut unread: Vec<String> = reader
        .means
        .iter()
        .filter_map(|(i, mean)| Some((i, mean.as_ref().err()?)))
        .map(|(i, why)| format!("images[{i}] ({why})"))
        .collect();
    if !unread.is_empty() {
        unread.sort_unstable();
        let list = super::note::names(&unread);
        notes.push(format!("{}: textures that cannot be read count as white: {list}", path.display()));
    }
    (described, notes)
}

struct Reader<'a> {
    root: &'a Root,
    buffers: &'a Buffers<'a>,
    path: &'a Path,
    means: Means,
    kinds: BTreeMap<&'static str, Vec<String>>,
}

impl Reader<'_> {
    fn say(&mut self, what: &'static str, name: &str) {
        let names = self.kinds.entry(what).or_default();
        if names.last().is_none_or(|last| last != name) {
            names.push(name.to_owned());
        }
    }

    /// The mean of a texture; white if there is none or it cannot be read.
    fn mean(&mut self, texture: Option<Index<Texture>>, name: &str) -> Mean {
        let white = Mean { colour: [1.0; 3], data: [1.0; 3] };
        let Some(texture) = texture.and_then(|t| self.root.textures.get(t.value())) else { return white };
        let index = texture.source.value();
        let Some(image) = self.root.images.get(index) else { return white };
        let (buffers, path) = (self.buffers, self.path);
        let read = || match (&image.buffer_view, &image.uri) {
            (Some(view), _) => texture::mean(buffers.view(*view)?),
            (None, Some(uri)) => texture::mean(&resource(uri, path)?),
            (None, None) => Err("it has no data".into()),
        };
        match self.means.entry(index).or_insert_with(read).clone() {
            Ok(mean) => {
                self.say("textures are replaced by their mean colour", name);
                mean
            }
            Err(_) => white,
        }
    }

    fn look(&mut self, name: &str, material: &Material) -> Look {
        let pbr = &material.pbr_metallic_roughness;
        let extensions = material.extensions.as_ref();
        let unit = |x: f32| f64::from(x).clamp(0.0, 1.0);
        let times = |a: Rgb, b: Rgb| [a[0] * b[0], a[1] * b[1], a[2] * b[2]];
        let three = |x: &[f32]| [0, 1, 2].map(|c| unit(x[c]));

        let base = three(&pbr.base_color_factor.0);
        let base = times(base, self.mean(pbr.base_color_texture.as_ref().map(|t| t.index), name).colour);
        let surface = self.mean(pbr.metallic_roughness_texture.as_ref().map(|t| t.index), name).data;
        let (metal, rough) =
            (unit(pbr.metallic_factor.0) * surface[2], unit(pbr.roughness_factor.0) * surface[1]);
        let index = extensions.and_then(|e| e.ior.as_ref()).map_or(INDEX, |i| f64::from(i.ior.0));
        // An index of 0 stands for the old way of giving specular colour: all light.
        let index = if index >= 1.0 { index.min(10.0) } else { INDEX };

        let strength = extensions.and_then(|e| e.emissive_strength.as_ref());
        let strength = strength.map_or(1.0, |s| f64::from(s.emissive_strength.0).clamp(0.0, MOST));
        let glow = material.emissive_factor.0.map(|x| f64::from(x).clamp(0.0, MOST));
        let glow = times(glow, self.mean(material.emissive_texture.as_ref().map(|t| t.index), name).colour);
        let emission = glow.map(|x| (x * strength).min(MOST));

        if material.normal_texture.is_some() || material.occlusion_texture.is_some() {
            self.say("normal and occlusion textures are left out", name);
        }
        let transmission = extensions.and_then(|e| e.transmission.as_ref());
        let transmitted = transmission.map_or(0.0, |t| unit(t.transmission_factor.0) * (1.0 - metal));
        let blended = matches!(material.alpha_mode, Checked::Valid(AlphaMode::Blend));
        let clear = blended && pbr.base_color_factor.0[3] < 0.5;
        if transmitted >= 0.5 || clear {
            if transmitted < 0.5 {
                self.say("taken for glass because its alpha is below 0.5", name);
            } else if rough > 0.05 {
                self.say("rough glass is taken as smooth", name);
            }
            let volume = extensions.and_then(|e| e.volume.as_ref()).and_then(|v| {
                let distance = f64::from(v.attenuation_distance.0);
                (distance > 0.0 && distance.is_finite()).then(|| (three(&v.attenuation_color.0), distance))
            });
            let body = match volume {
                Some((filter, over)) => Body::Glass { index, filter, over: Some(over) },
                None => Body::Glass { index, filter: base, over: None },
            };
            return Look { body, emission, two_sided: false };
        }
        if transmitted > 0.0 || blended {
            self.say("taken as opaque though it is partly transparent", name);
        }
        if matches!(material.alpha_mode, Checked::Valid(AlphaMode::Mask)) {
            self.say("a mask is left out, the whole surface is there", name);
        }
        let specular = extensions.and_then(|e| e.specular.as_ref());
        let (factor, tint) = specular.map_or((1.0, [1.0; 3]), |s| {
            let tint = s.specular_color_factor.0.map(|x| f64::from(x).clamp(0.0, 100.0));
            (unit(s.specular_factor.0), tint)
        });
        let body = tint.map(|t| (factor * t * normal_reflectance(index)).min(1.0));
        let normal = [0, 1, 2].map(|c| (1.0 - metal) * body[c] + metal * base[c]);
        let diffuse = [0, 1, 2].map(|c| (1.0 - metal) * base[c] * (1.0 - body[c]));
        let index = (metal < 0.5).then_some(index);
        let body = Body::Opaque { diffuse, specular: normal, index, m: rough * rough };
        Look { body, emission, two_sided: material.double_sided }
    }
}
