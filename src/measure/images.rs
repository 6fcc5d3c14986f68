//! Where specular surfaces show emitters: rays are sent closer together there.

use super::cell::Cell;
use super::direct::emitters;
use super::place::Place;
use crate::geometry::{Side, SurfaceId};
use crate::material::Transmission;
use crate::second_pass::LitScene;
use glam::{DVec3, Vec3};

/// Rays that meet one image, at least; those at its edge are a few per cent of them.
const RAYS: f64 = 1024.0;
/// A lobe of slope m is met by rays this share of m apart, and ends so many times m beside the image.
const LOBE_STEP: f64 = 0.2;
const LOBE_REACH: f64 = 4.0;

/// What one side of a surface shows to a sensor.
#[derive(Default)]
pub(super) struct Images {
    /// Direction, half its angle (rad), projected solid angle (sr).
    images: Vec<(DVec3, f64, f64)>,
    /// Roughness of the surface.
    m: f64,
}

/// With more emitters than this rays are spread over the surfaces alone: so many lights are an even one.
const MOST: usize = 1024;

/// All that can be shown.
pub(super) struct Emitters<'a> {
    /// Emitting surfaces, and lights as cells without extent.
    cells: Vec<Cell<'a>>,
}

impl<'a> Emitters<'a> {
    /// Of a scene.
    pub fn new(scene: &LitScene<'a>) -> Self {
        let mut cells = emitters(scene);
        // On a surface that it has nothing to do with: only the corners count.
        let point = |p: DVec3| Cell {
            corners: [p.as_vec3(); 4],
            piece: None,
            surface: SurfaceId(0),
            side: Side::Front,
            depth: 0,
        };
        cells.extend(scene.geometry.lights.iter().map(|l| point(l.place())));
        if cells.len() > MOST {
            cells.clear();
        }
        Emitters { cells }
    }

    /// What `surface` shows of them to `place`: mirrored, and for a pane straight as well.
    pub fn images(&self, scene: &LitScene, place: &Place, surface: SurfaceId, side: Side) -> Images {
        let material = scene.appearance.of(surface);
        // The images in a curved mirror are small and anywhere: rays are spread evenly over it.
        let Some(plane) = scene.geometry.surface(surface).plane() else { return Images::default() };
        let turn = if side == Side::Front { 1.0 } else { -1.0 };
        let mirrored = |p: Vec3| {
            let p = p.as_dvec3();
            (p - 2.0 * plane.height(p) * plane.normal).as_vec3()
        };
        let in_front = |cell: &Cell| cell.corners.iter().any(|c| turn * plane.height(c.as_dvec3()) > 0.0);
        let behind = |cell: &Cell| cell.corners.iter().any(|c| turn * plane.height(c.as_dvec3()) < 0.0);
        let pane = matches!(material.transmission, Some(Transmission::Pane { .. }));
        let mut images = Images { images: Vec::new(), m: material.m };
        for cell in &self.cells {
            if in_front(cell) {
                // The image of a disc or a sphere counts by its corners: it only says where to look closely.
                images.add(place, &Cell { corners: cell.corners.map(mirrored), piece: None, ..*cell });
            }
            if pane && behind(cell) {
                images.add(place, cell);
            }
        }
        images
    }
}

impl Images {
    fn add(&mut self, place: &Place, image: &Cell) {
        if let Some(direction) = (image.centre().as_dvec3() - place.position).try_normalize() {
            self.images.push((direction, 0.5 * image.extent(place), image.factor(place)));
        }
    }

    /// Whether `cell` of the surface, with its projected solid angle, may show an image and is too
    /// large for it.
    pub fn divide(&self, place: &Place, cell: &Cell, factor: f64) -> bool {
        let extent = cell.extent(place);
        let Some(direction) = (cell.centre().as_dvec3() - place.position).try_normalize() else {
            return false;
        };
        let reach = 0.5 * extent + LOBE_REACH * self.m;
        self.images.iter().any(|(to, half, size)| {
            let near = direction.angle_between(*to) <= half + reach;
            let rough = self.m > 0.0 && extent <= LOBE_STEP * self.m;
            near && !rough && factor * RAYS > *size && (*size > 0.0 || self.m > 0.0)
        })
    }
}
