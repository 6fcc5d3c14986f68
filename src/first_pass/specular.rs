//! Specular points: what each sees, in which directions, and where radiance goes from one to the next.

use super::directions::{Direction, Directions, LANES, Origin};
use super::lobe_table::BAND;
use super::member::{Frame, members, outside};
use super::nodes::Nodes;
use super::rows::Rows;
use super::settings::FirstPassSettings;
pub use super::specular_material::{Shape, SpecularMaterial, is_rough};
use crate::geometry::Side;
use crate::observer::Observer;
use crate::points::{NO_POINT, SamplePoints};
use crate::scene::SampledAppearance;
use crate::visibility::VisibilityGraph;
use rayon::prelude::*;

/// A member that another specular point's radiance comes from.
#[derive(Clone, Copy, Debug)]
pub struct Link {
    /// Its place among the members.
    pub member: u32,
    /// The specular point.
    pub point: u32,
    /// The link back among that point's links, or [`NO_POINT`].
    pub back: u32,
}

/// A sample point that reflects or transmits specularly, and what it sees (its V_s).
#[derive(Clone, Debug)]
pub struct SpecularPoint {
    /// Index of the sample point.
    pub point: u32,
    /// The specular point on the other side of the glass.
    pub twin: Option<u32>,
    /// Index of its material.
    pub material: usize,
    /// Whether it is on the inside of a solid.
    pub inside: bool,
    /// Sample points seen, [`NO_POINT`] for a black cell: specular points first, each kind in the order of
    /// directions.
    pub members: Vec<u32>,
    /// Groups of directions that hold specular points.
    pub link_groups: usize,
    /// q of each member as seen from here.
    pub q_in: Vec<f32>,
    /// q of this element as seen from each member; 0 for a cell.
    pub q_out: Vec<f32>,
    /// Distance of each member if light is absorbed on the way, else empty; m.
    pub distance: Vec<f32>,
    /// The members as directions of reflection.
    pub reflection: Directions,
    /// The members as directions outside the glass, for transmission.
    pub transmission: Option<Directions>,
    /// Members that are specular points themselves, by specular point.
    pub links: Vec<Link>,
    /// Deviation (mean, largest) of its rough or refracting lobes from their directional albedo, as far as they have
    /// been scaled.
    pub(super) errors: Vec<(f64, f64)>,
    /// Whether its lobes have been scaled.
    pub(super) scaled: bool,
    /// Nodes of its reflection, where they pay.
    pub(super) nodes: Option<Nodes>,
    /// The rows of its reflection: between nodes if it has any.
    pub(super) rows: Rows,
    /// The rows of what goes from here through the glass.
    pub(super) through: Option<Rows>,
}

/// All specular points of a scene.
#[derive(Clone, Debug, Default)]
pub struct SpecularSet {
    /// By ascending sample point.
    pub points: Vec<SpecularPoint>,
    /// By material; `None` for a material without specular part.
    pub materials: Vec<Option<SpecularMaterial>>,
    /// Number of wavelengths.
    pub wavelengths: usize,
    /// Mean and largest deviation of a lobe from its directional albedo.
    pub closure_error: (f64, f64),
    /// Black cells that stand for openings.
    pub cells: u64,
    /// Points whose lobes are those of an earlier set.
    pub reused: u64,
    /// How many ideal lobes have been balanced: of mirrors, and of what goes straight through panes; and the
    /// deviations left.
    pub(super) balanced: [(usize, Option<(f64, f64)>); 2],
}

/// m² of the lobe that the normals of element `i` make by themselves: 0 where it is flat. Its neighbours on a sphere
/// stand on all sides, their normals as far apart as it is wide: Gaussians of a variance of 3 / 4π of the square of
/// that distance add up to an even light within 2 %, as for the blur of rough lobes.
fn normal_spread(points: &SamplePoints, i: usize) -> f32 {
    let bend2 = points.round(i).map_or(0.0, |piece| piece.bend2());
    (2.0 * 3.0 / (4.0 * std::f64::consts::PI) * bend2) as f32
}

impl SpecularSet {
    /// Finds the specular points, what they see, and the scale factors of their lobes. Points of the set of an
    /// `earlier` appearance, by the same settings, are used again where nothing they depend on has changed.
    pub fn new(
        points: &SamplePoints,
        graph: &VisibilityGraph,
        appearance: &SampledAppearance,
        (settings, tolerance): (&FirstPassSettings, f32),
        earlier: Option<SpecularSet>,
        observer: &dyn Observer,
    ) -> Self {
        let known = earlier.as_ref().map_or(&[][..], |set| &set.materials);
        let materials = SpecularMaterial::all(&appearance.materials, known);
        let material_of = |i: usize| appearance.surface_material[points.surface[i].index()].0 as usize;
        let is_specular = |i: usize| materials[material_of(i)].is_some();
        let chosen: Vec<u32> = (0..points.len()).filter(|&i| is_specular(i)).map(|i| i as u32).collect();
        let inside = |i: usize| {
            points.side[i] == Side::Back
                && materials[material_of(i)].as_ref().is_some_and(|m| m.reflect_inside.is_some())
        };
        let build = |&i: &u32| {
            let i = i as usize;
            let material = material_of(i);
            let glass = materials[material].as_ref().and_then(|m| m.transmit.as_ref()).is_some();
            let twin = (glass && points.twin[i] != NO_POINT)
                .then(|| chosen.binary_search(&points.twin[i]).ok().map(|t| t as u32))
                .flatten();
            let linked = |j: u32| chosen.binary_search(&j).is_ok();
            let (members, linked) = members(points, graph, settings.kernel, tolerance, i, linked);
            let directions: Vec<Direction> = members.iter().map(|m| m.direction).collect();
            let (m2, n2) = materials[material].as_ref().map_or((0.0, 1.0), |m| (m.m2, m.n2));
            let turning = if glass { 0.0 } else { normal_spread(points, i) };
            let mirror = Origin { m2: m2 + turning, side: Frame::new(points, i).side, straight: true };
            let attenuates =
                inside(i) || members.iter().any(|m| m.point != NO_POINT && inside(m.point as usize));
            SpecularPoint {
                point: i as u32,
                twin,
                material,
                inside: inside(i),
                members: members.iter().map(|m| m.point).collect(),
                link_groups: linked.div_ceil(LANES),
                q_in: members.iter().map(|m| m.q_in).collect(),
                q_out: members.iter().map(|m| m.q_out).collect(),
                distance: if attenuates { members.iter().map(|m| m.distance).collect() } else { Vec::new() },
                reflection: Directions::new(mirror, &directions),
                transmission: twin.map(|_| {
                    let window = Origin { m2: 0.0, straight: n2 == 1.0, ..mirror };
                    if inside(i) {
                        outside(window, &directions, n2)
                    } else {
                        Directions::new(window, &directions)
                    }
                }),
                links: Vec::new(),
                errors: Vec::new(),
                scaled: false,
                nodes: None,
                rows: Rows::default(),
                through: None,
            }
        };
        if chosen.is_empty() {
            return SpecularSet {
                materials,
                wavelengths: appearance.wavelengths.len(),
                ..Default::default()
            };
        }
        let mut set = SpecularSet {
            points: Vec::new(),
            wavelengths: appearance.wavelengths.len(),
            closure_error: (0.0, 0.0),
            cells: 0,
            reused: 0,
            balanced: earlier.as_ref().map_or_else(Default::default, |set| set.balanced),
            materials: Vec::new(),
        };
        let before = earlier.as_ref().map_or(0, |set| set.points.len());
        let mut kept = earlier.map_or_else(Vec::new, |earlier| {
            let shape = |i: usize| materials[material_of(i)].as_ref().map(SpecularMaterial::shape);
            earlier.kept(points, shape)
        });
        kept.resize_with(points.len(), || None);
        let mut found: Vec<(u32, Option<SpecularPoint>)> =
            chosen.iter().map(|&i| (i, kept[i as usize].take())).collect();
        // What solids reflect is balanced together with all mirrors, before it is scaled together with what they refract.
        if before != chosen.len() || found.iter().any(|f| f.1.is_none()) {
            let refracts = |p: &SpecularPoint| p.transmission.as_ref().is_some_and(|t| !t.origin.straight);
            found.iter_mut().for_each(|f| f.1 = f.1.take().filter(|p| !refracts(p)));
        }
        set.reused = found.iter().filter(|f| f.1.as_ref().is_some_and(|p| p.scaled)).count() as u64;
        observer.begin("specular points", chosen.len() as u64 - set.reused);
        let fresh = |(i, kept): (u32, Option<SpecularPoint>)| match kept {
            Some(kept) => {
                let glass = kept.twin.is_some();
                let twin = chosen.binary_search(&points.twin[i as usize]).ok().filter(|_| glass);
                let (material, twin) = (material_of(i as usize), twin.map(|t| t as u32));
                let point = SpecularPoint { material, twin, ..kept };
                if point.scaled {
                    return point;
                }
                let m2 = materials[material].as_ref().map_or(0.0, |m| m.m2);
                let reflection =
                    point.reflection.roughened(m2 + normal_spread(points, i as usize), settings.recall);
                observer.advance(1);
                SpecularPoint { reflection, errors: Vec::new(), ..point }
            }
            None => {
                let point = build(&i);
                observer.advance(1);
                point
            }
        };
        set.points = found.into_par_iter().map(fresh).collect();
        set.materials = materials;
        observer.end();
        set.connect();
        set.find_rows(settings.lobe_tolerance as f32, settings.kept_bytes);
        set.normalise(points, observer);
        set.cells = set.points.iter().flat_map(|p| &p.members).filter(|&&m| m == NO_POINT).count() as u64;
        set
    }

    /// The points, by sample point, whose lobes hold where `shape` is that of the material that a sample point
    /// wears now ([`SpecularMaterial::shape`]); and, not scaled, those of which at least the directions hold.
    fn kept(
        self,
        points: &SamplePoints,
        shape: impl Fn(usize) -> Option<Shape> + Sync,
    ) -> Vec<Option<SpecularPoint>> {
        let mut before = vec![None; points.len()];
        for point in &self.points {
            before[point.point as usize] = self.material(point).map(SpecularMaterial::shape);
        }
        // What others see of a point is whether it is specular, and whether it is inside a solid.
        let seen = |shape: Option<Shape>| shape.map(|s| s.3.is_some());
        let changed: Vec<bool> = (0..points.len()).map(|i| seen(before[i]) != seen(shape(i))).collect();
        let rough = |shape: Option<Shape>| shape.is_some_and(|s| is_rough(&s));
        let holds = |point: &SpecularPoint| {
            let i = point.point as usize;
            (before[i] == shape(i) || rough(before[i]) && rough(shape(i)))
                && !point.members.iter().any(|&m| m != NO_POINT && changed[m as usize])
        };
        let holds: Vec<bool> = self.points.par_iter().map(holds).collect();
        let mut kept: Vec<Option<SpecularPoint>> = Vec::new();
        kept.resize_with(points.len(), || None);
        for (s, mut point) in self.points.into_iter().enumerate() {
            point.scaled = before[point.point as usize] == shape(point.point as usize);
            // The two sides of a pane share their lobes.
            if holds[s] && point.twin.is_none_or(|t| holds[t as usize]) {
                let i = point.point as usize;
                kept[i] = Some(point);
            }
        }
        kept
    }

    /// The material of a specular point.
    pub fn material(&self, point: &SpecularPoint) -> Option<&SpecularMaterial> {
        self.materials[point.material].as_ref()
    }

    /// Bands of wavelengths.
    pub fn bands(&self) -> usize {
        self.wavelengths.div_ceil(BAND)
    }

    /// Finds the links, and for every link the link back.
    fn connect(&mut self) {
        let place: std::collections::HashMap<u32, u32> =
            self.points.iter().enumerate().map(|(s, p)| (p.point, s as u32)).collect();
        self.points.par_iter_mut().for_each(|p| {
            // Specular points stand first.
            let linked = p.members.iter().enumerate().map_while(|(member, m)| {
                Some(Link { member: member as u32, point: *place.get(m)?, back: NO_POINT })
            });
            p.links = linked.collect();
            p.links.sort_by_key(|l| l.point);
        });
        let back: Vec<Vec<u32>> = (0..self.points.len())
            .into_par_iter()
            .map(|s| {
                let find = |link: &Link| {
                    let links = &self.points[link.point as usize].links;
                    links.binary_search_by_key(&(s as u32), |l| l.point).map_or(NO_POINT, |at| at as u32)
                };
                self.points[s].links.iter().map(find).collect()
            })
            .collect();
        for (point, back) in self.points.iter_mut().zip(back) {
            for (link, back) in point.links.iter_mut().zip(back) {
                link.back = back;
            }
        }
    }
}
