//! Specular points: what each sees, in which directions, and where radiance goes from one to the next.

use super::balance::{Element, balance};
use super::bounce::reflectance;
use super::directions::{Direction, Directions, LANES, Origin};
use super::lobe_table::{BAND, LobeTable};
use super::member::{Frame, members, outside};
use super::normalise::{Face, normalise_reflection, normalise_solid};
use super::settings::Kernel;
use crate::geometry::{Round, Side};
use crate::material::{AlbedoTable, Transmission};
use crate::observer::Observer;
use crate::points::{NO_POINT, Piece, SamplePoints};
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
    errors: Vec<(f64, f64)>,
    /// Whether its lobes have been scaled.
    scaled: bool,
}

/// What a material does with specular light.
#[derive(Clone, Debug)]
pub struct SpecularMaterial {
    /// m.
    m: f64,
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
    pub(super) albedo: AlbedoTable,
}

/// What the lobes of a material depend on: the bits of m and of n², whether there is transmission, and the tables of
/// a solid.
type Shape = (u64, u32, bool, Option<[Option<u64>; 3]>);

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
    balanced: [(usize, Option<(f64, f64)>); 2],
}

impl SpecularPoint {
    /// The ideal lobe of its reflection, or of what goes straight `through` it, if it has one.
    fn straight_lobe(&mut self, through: bool) -> Option<&mut Directions> {
        let lobe = if through { self.transmission.as_mut() } else { Some(&mut self.reflection) };
        lobe.filter(|d| d.origin.m2 == 0.0 && d.origin.straight)
    }
}

impl SpecularMaterial {
    /// What lobes depend on.
    fn shape(&self) -> Shape {
        // What a solid reflects and refracts is scaled together, by how much of each there is.
        let tables = [Some(&self.reflect), self.reflect_inside.as_ref(), self.transmit.as_ref()];
        let tables = self.reflect_inside.is_some().then(|| tables.map(|t| t.map(LobeTable::fingerprint)));
        (self.m.to_bits(), self.n2.to_bits(), self.transmit.is_some(), tables)
    }

    /// `None` when there is nothing specular about the material.
    fn new(material: &crate::material::SampledMaterial) -> Option<Self> {
        if !material.is_specular() {
            return None;
        }
        let share = material.s as f32;
        let mut specular = SpecularMaterial {
            m: material.m,
            m2: (material.m * material.m) as f32,
            reflect: LobeTable::new(&material.reflect, share, false),
            reflect_inside: None,
            transmit: None,
            n2: 1.0,
            absorption: Vec::new(),
            albedo: AlbedoTable::new(material.m),
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
        Some(specular)
    }
}

/// m² of the lobe that the normals of element `i` make by themselves: 0 where it is flat. Its neighbours on the sphere
/// stand on all sides, their normals as far apart as it is wide: Gaussians of a variance of 3 / 4π of the square of
/// that distance add up to an even light within 2 %, as for the blur of rough lobes.
fn normal_spread(points: &SamplePoints, i: usize) -> f32 {
    match points.round(i) {
        Some(Piece { round: Round::Sphere(sphere), .. }) => {
            let variance =
                3.0 / (4.0 * std::f32::consts::PI) * points.area[i] / (sphere.radius * sphere.radius) as f32;
            2.0 * variance
        }
        _ => 0.0,
    }
}

impl SpecularSet {
    /// Finds the specular points, what they see, and the scale factors of their lobes. Points of the set of an
    /// `earlier` appearance, by the same kernel and tolerance, are used again where nothing they depend on has
    /// changed.
    pub fn new(
        points: &SamplePoints,
        graph: &VisibilityGraph,
        appearance: &SampledAppearance,
        (kernel, tolerance): (Kernel, f32),
        earlier: Option<SpecularSet>,
        observer: &dyn Observer,
    ) -> Self {
        let materials: Vec<_> = appearance.materials.iter().map(SpecularMaterial::new).collect();
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
            let (members, linked) = members(points, graph, kernel, tolerance, i, linked);
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
        set.reused = found.iter().filter(|f| f.1.is_some()).count() as u64;
        observer.begin("specular points", chosen.len() as u64 - set.reused);
        let fresh = |(i, kept): (u32, Option<SpecularPoint>)| match kept {
            Some(kept) => {
                let glass = kept.twin.is_some();
                let twin = chosen.binary_search(&points.twin[i as usize]).ok().filter(|_| glass);
                let (material, twin) = (material_of(i as usize), twin.map(|t| t as u32));
                SpecularPoint { material, twin, ..kept }
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
        set.normalise(points, observer);
        set.cells = set.points.iter().flat_map(|p| &p.members).filter(|&&m| m == NO_POINT).count() as u64;
        set
    }

    /// The points, by sample point, whose lobes hold where `shape` is that of the material that a sample point
    /// wears now ([`SpecularMaterial::shape`]).
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
        let holds = |point: &SpecularPoint| {
            let i = point.point as usize;
            before[i] == shape(i) && !point.members.iter().any(|&m| m != NO_POINT && changed[m as usize])
        };
        let holds: Vec<bool> = self.points.par_iter().map(holds).collect();
        let mut kept: Vec<Option<SpecularPoint>> = Vec::new();
        kept.resize_with(points.len(), || None);
        for (s, point) in self.points.into_iter().enumerate() {
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

    /// Scales all lobes that are not yet scaled to their directional albedo.
    fn normalise(&mut self, sample: &SamplePoints, observer: &dyn Observer) {
        let materials = &self.materials;
        let new = || self.points.iter().filter(|p| !p.scaled);
        let lobes: usize = new().map(|p| 1 + usize::from(p.transmission.is_some())).sum();
        observer.begin("specular lobes", lobes as u64);
        self.points
            .par_iter_mut()
            .filter(|p| !p.scaled)
            .filter_map(|p| materials[p.material].as_ref().map(|m| (p, m)))
            .filter(|(p, _)| p.reflection.origin.m2 > 0.0)
            .for_each(|(p, m)| {
                p.errors.push(normalise_reflection(&mut p.reflection, &m.albedo));
                observer.advance(1);
            });
        for through in [false, true] {
            self.balanced[usize::from(through)] = self.balance(sample, through, observer);
        }
        self.normalise_solids(observer);
        observer.end();
        self.points.iter_mut().for_each(|p| p.scaled = true);
        let balanced = self.balanced.iter().filter_map(|b| b.1.as_ref());
        let errors: Vec<(f64, f64)> =
            self.points.iter().flat_map(|p| &p.errors).chain(balanced).copied().collect();
        if !errors.is_empty() {
            let mean = errors.iter().map(|e| e.0).sum::<f64>() / errors.len() as f64;
            self.closure_error = (mean, errors.iter().map(|e| e.1).fold(0.0, f64::max));
        }
    }

    /// Scales what solids reflect and refract, and notes what balancing did not place in its lobe.
    fn normalise_solids(&mut self, observer: &dyn Observer) {
        let pairs: Vec<(usize, usize)> = (self.points.iter().enumerate())
            .filter(|(_, p)| {
                !p.scaled && !p.inside && p.transmission.as_ref().is_some_and(|t| !t.origin.straight)
            })
            .filter_map(|(s, p)| p.twin.map(|t| (s, t as usize)))
            .collect();
        let scaled: Vec<_> = pairs
            .par_iter()
            .filter_map(|&(s, t)| {
                let material = self.material(&self.points[s])?;
                let transmit = material.transmit.as_ref()?;
                let mut lobes = [s, t].map(|s| {
                    let p = &self.points[s];
                    (p.reflection.clone(), p.transmission.clone().unwrap_or_default())
                });
                let [a, b] = &mut lobes;
                let face = |s: usize, (reflection, transmission)| Face {
                    reflection,
                    transmission,
                    reflect: reflectance(&self.points[s], material),
                };
                let error = normalise_solid(
                    face(s, (&mut a.0, &mut a.1)),
                    face(t, (&mut b.0, &mut b.1)),
                    transmit,
                    material.n2,
                );
                observer.advance(2);
                Some((s, t, lobes, error))
            })
            .collect();
        for (s, t, lobes, error) in scaled {
            for (s, (reflection, transmission)) in [s, t].into_iter().zip(lobes) {
                self.points[s].reflection = reflection;
                self.points[s].transmission = Some(transmission);
            }
            self.points[s].errors.push(error);
        }
    }

    /// Balances the ideal lobes of all mirrors, or of what goes straight `through` panes, unless all of them have been.
    /// Returns their number, and the deviation left.
    fn balance(
        &mut self,
        sample: &SamplePoints,
        through: bool,
        observer: &dyn Observer,
    ) -> (usize, Option<(f64, f64)>) {
        let chosen: Vec<usize> =
            (0..self.points.len()).filter(|&s| self.points[s].straight_lobe(through).is_some()).collect();
        let before = self.balanced[usize::from(through)];
        if chosen.len() == before.0 && chosen.iter().all(|&s| self.points[s].scaled) {
            return before;
        }
        let place = |s: usize| chosen.binary_search(&s).ok();
        let mut groups = std::collections::BTreeMap::new();
        let mut elements: Vec<Element> = Vec::new();
        for (at, &s) in chosen.iter().enumerate() {
            let point = &mut self.points[s];
            let i = point.point as usize;
            let next = groups.len();
            let group = *groups.entry((sample.surface[i], sample.side[i] == Side::Back)).or_insert(next);
            let mut directions = point.straight_lobe(through).map(std::mem::take).unwrap_or_default();
            directions.scale.fill([1.0; LANES]);
            elements.push(Element {
                directions,
                other: if through { point.twin.and_then(|t| place(t as usize)).unwrap_or(at) } else { at },
                group,
                area: sample.area[i],
                members: std::mem::take(&mut point.members),
            });
        }
        let error = (!elements.is_empty()).then(|| balance(&mut elements, sample.len(), observer));
        for (&s, element) in chosen.iter().zip(elements) {
            let point = &mut self.points[s];
            point.members = element.members;
            if through {
                point.transmission = Some(element.directions);
            } else {
                point.reflection = element.directions;
            }
        }
        (chosen.len(), error)
    }
}
