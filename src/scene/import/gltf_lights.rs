//! What the nodes of a glTF file hold besides meshes: lights and cameras.

use super::super::description::{CameraTable, LightTable, SpectrumRef};
use super::gltf::{Read, Reader};
use crate::colour::linear_srgb_luminance;
use glam::{DMat3, DMat4, DVec3};
use gltf::json::Node;
use gltf::json::extensions::scene::khr_lights_punctual::Type as LightType;
use gltf::json::validation::Checked;

/// More lights than this are refused: each is asked for from every sample point.
const MOST_LIGHTS: usize = 10_000;
/// Lights of more are left out, cd or lx.
const MOST_LIGHT: f64 = 1e15;

impl Reader<'_> {
    /// Adds light number `light`, which node number `index` puts at `place`.
    pub fn light(&mut self, light: usize, index: usize, node: &Node, place: DMat4) -> Read {
        let lights = self.root.extensions.as_ref().and_then(|e| e.khr_lights_punctual.as_ref());
        let Some(light) = lights.and_then(|l| l.lights.get(light)) else { return Ok(()) };
        let Checked::Valid(kind) = light.type_ else { return Ok(()) };
        let colour = light.color.map(|x| f64::from(x).clamp(0.0, 1e6));
        let luminance = linear_srgb_luminance(colour);
        let amount = f64::from(light.intensity) * luminance;
        if !(amount > 0.0 && amount <= MOST_LIGHT) {
            if amount != 0.0 {
                self.ignored
                    .insert(format!("lights of less than nothing or more than {MOST_LIGHT:e} cd or lx"));
            }
            return Ok(());
        }
        if self.model.lights.len() == MOST_LIGHTS {
            return Err(format!("there are more than {MOST_LIGHTS} lights; leave some out"));
        }
        let called = node.name.as_ref().or(light.name.as_ref()).filter(|n| !n.is_empty());
        let name = self.unique(called.cloned().unwrap_or_else(|| format!("light {index}")));
        let mut table = LightTable {
            name: self.here(name),
            position: Some(self.here(place.transform_point3(DVec3::ZERO).to_array())),
            distribution: None,
            direction: None,
            inner_cone_deg: None,
            outer_cone_deg: None,
            diameter_deg: None,
            ies: None,
            c0: None,
            up: None,
            spread: None,
            illuminant: None,
            spectrum: Some(self.here(SpectrumRef::Rgb(colour.map(|x| x / luminance)))),
            luminous_flux: None,
            luminous_intensity: Some(self.here(amount)),
            illuminance: None,
            scale: None,
        };
        let forward = (DMat3::from_mat4(place) * DVec3::NEG_Z).normalize_or(DVec3::NEG_Z);
        match kind {
            LightType::Point => {}
            LightType::Spot => {
                let (inner, outer) = light.spot.as_ref().map_or((0.0, std::f64::consts::FRAC_PI_4), |spot| {
                    (f64::from(spot.inner_cone_angle), f64::from(spot.outer_cone_angle))
                });
                let outer = outer.to_degrees().clamp(0.01, 90.0);
                let inner = inner.to_degrees().clamp(0.0, outer);
                table.distribution = Some(self.here("spot".to_owned()));
                table.direction = Some(self.here(forward.to_array()));
                table.inner_cone_deg = Some(self.here(inner));
                table.outer_cone_deg = Some(self.here(outer));
            }
            LightType::Directional => {
                table.position = None;
                table.distribution = Some(self.here("directional".to_owned()));
                table.direction = Some(self.here(forward.to_array()));
                table.luminous_intensity = None;
                table.illuminance = Some(self.here(amount));
            }
        }
        self.model.lights.push(table);
        Ok(())
    }

    /// Adds camera number `camera`, which node number `index` puts at `place`.
    pub fn camera(&mut self, camera: usize, index: usize, node: &Node, place: DMat4) {
        let Some(camera) = self.root.cameras.get(camera) else { return };
        let Some(perspective) = &camera.perspective else {
            self.ignored.insert("orthographic cameras".into());
            return;
        };
        let linear = DMat3::from_mat4(place);
        let (forward, up) = (linear * DVec3::NEG_Z, linear * DVec3::Y);
        let fov_deg = f64::from(perspective.yfov).to_degrees();
        let (Some(forward), Some(up)) = (forward.try_normalize(), up.try_normalize()) else { return };
        if !(fov_deg > 0.0 && fov_deg < 180.0) || forward.cross(up).length() < 1e-3 {
            self.ignored.insert("cameras without an image".into());
            return;
        }
        let called = node.name.as_ref().or(camera.name.as_ref()).filter(|n| !n.is_empty());
        let name = self.unique(called.cloned().unwrap_or_else(|| format!("camera {index}")));
        let at = place.transform_point3(DVec3::ZERO);
        let aspect = f64::from(perspective.aspect_ratio.unwrap_or(4.0 / 3.0));
        let height = if aspect > 0.0 { (640.0 / aspect).round().clamp(1.0, 4096.0) } else { 480.0 };
        self.model.cameras.push(CameraTable {
            name: self.here(name),
            position: self.here(at.to_array()),
            target: self.here((at + forward).to_array()),
            up: Some(self.here(up.to_array())),
            fov_deg: Some(self.here(fov_deg)),
            resolution: Some(self.here([640, height as u32])),
        });
    }
}
