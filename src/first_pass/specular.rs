//! Specular points: what each sees, in which directions, and where radiance goes from one to the next.

use super::balance::{Element, balance};
use super::bounce::reflectance;
use super::directions::{Direction, Directions, LANES, Origin};
use super::lobe_table::{BAND, LobeTable};
use super::member::{Frame, members, outside};
use super::normalise::{Face, normalise_reflection, normalise_solid};
use super::settings::Kernel;
use crate::geometry::Side;
use crate::material::{AlbedoTable, Transmission};
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
}

/// What a material does with specular light.
#[derive(Clone, Debug)]
pub struct SpecularMaterial {
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
}

impl SpecularPoint {
    /// The ideal lobe of its reflection, or of what goes straight `through` it, if it has one.
    fn straight_lobe(&mut self, through: bool) -> Option<&mut Directions> {
        let lobe = if through { self.transmission.as_mut() } else { Some(&mut self.reflection) };
        lobe.filter(|d| d.origin.m2 == 0.0 && d.origin.straight)
    }
}

impl SpecularMaterial {
    /// `None` when there is nothing specular about the material.
    fn new(material: &crate::material::SampledMaterial) -> Option<Self> {
        if !material.is_specular() {
            return None;
        }
        let share = material.s as f32;
        let mut specular = SpecularMaterial {
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

impl SpecularSet {
    /// Finds the specular points, what they see, and the scale factors of their lobes.
    pub fn new(
        points: &SamplePoints,
        graph: &VisibilityGraph,
        appearance: &SampledAppearance,
        kernel: Kernel,
        tolerance: f32,
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
            let mirror = Origin { m2, side: Frame::new(points, i).side, straight: true };
            let attenuates =
                inside(i) || members.iter().any(|m| m.point != NO_POINT && inside(m.point as usize));
            let mut links: Vec<Link> = members
                .iter()
                .enumerate()
                .filter_map(|(member, m)| {
                    let point = chosen.binary_search(&m.point).ok()? as u32;
                    Some(Link { member: member as u32, point, back: NO_POINT })
                })
                .collect();
            links.sort_by_key(|l| l.point);
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
                links,
            }
        };
        if chosen.is_empty() {
            return SpecularSet {
                materials,
                wavelengths: appearance.wavelengths.len(),
                ..Default::default()
            };
        }
        observer.begin("specular points", chosen.len() as u64);
        let mut set = SpecularSet {
            points: chosen.par_iter().map(build).inspect(|_| observer.advance(1)).collect(),
            materials,
            wavelengths: appearance.wavelengths.len(),
            closure_error: (0.0, 0.0),
            cells: 0,
        };
        observer.end();
        set.connect();
        set.normalise(points, observer);
        set.cells = set.points.iter().flat_map(|p| &p.members).filter(|&&m| m == NO_POINT).count() as u64;
        set
    }

    /// The material of a specular point.
    pub fn material(&self, point: &SpecularPoint) -> Option<&SpecularMaterial> {
        self.materials[point.material].as_ref()
    }

    /// Bands of wavelengths.
    pub fn bands(&self) -> usize {
        self.wavelengths.div_ceil(BAND)
    }

    /// Finds for every link the link back.
    fn connect(&mut self) {
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

    /// Scales all lobes to their directional albedo.
    fn normalise(&mut self, sample: &SamplePoints, observer: &dyn Observer) {
        let materials = &self.materials;
        let lobes: usize = self.points.iter().map(|p| 1 + usize::from(p.transmission.is_some())).sum();
        observer.begin("specular lobes", lobes as u64);
        let mut errors: Vec<(f64, f64)> = self
            .points
            .par_iter_mut()
            .filter_map(|p| materials[p.material].as_ref().map(|m| (p, m)))
            .filter(|(_, m)| m.m2 > 0.0)
            .map(|(p, m)| normalise_reflection(&mut p.reflection, &m.albedo))
            .inspect(|_| observer.advance(1))
            .collect();
        errors.extend(self.balance(sample, false, observer));
        errors.extend(self.balance(sample, true, observer));
        errors.extend(self.normalise_solids(observer));
        observer.end();
        if !errors.is_empty() {
            let mean = errors.iter().map(|e| e.0).sum::<f64>() / errors.len() as f64;
            self.closure_error = (mean, errors.iter().map(|e| e.1).fold(0.0, f64::max));
        }
    }

    /// Scales what solids reflect and refract. Returns what balancing did not place in its lobe, by pairs of points.
    fn normalise_solids(&mut self, observer: &dyn Observer) -> Vec<(f64, f64)> {
        let pairs: Vec<(usize, usize)> = (self.points.iter().enumerate())
            .filter(|(_, p)| !p.inside && p.transmission.as_ref().is_some_and(|t| !t.origin.straight))
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
        let put = |(s, t, lobes, error): (usize, usize, [(Directions, Directions); 2], _)| {
            for (s, (reflection, transmission)) in [s, t].into_iter().zip(lobes) {
                self.points[s].reflection = reflection;
                self.points[s].transmission = Some(transmission);
            }
            error
        };
        scaled.into_iter().map(put).collect()
    }

    /// Balances the ideal lobes of all mirrors, or of what goes straight `through` panes. Returns the deviation left.
    fn balance(
        &mut self,
        sample: &SamplePoints,
        through: bool,
        observer: &dyn Observer,
    ) -> Option<(f64, f64)> {
        let chosen: Vec<usize> =
            (0..self.points.len()).filter(|&s| self.points[s].straight_lobe(through).is_some()).collect();
        let place = |s: usize| chosen.binary_search(&s).ok();
        let mut groups = std::collections::BTreeMap::new();
        let mut elements: Vec<Element> = Vec::new();
        for (at, &s) in chosen.iter().enumerate() {
            let point = &mut self.points[s];
            let i = point.point as usize;
            let next = groups.len();
            let group = *groups.entry((sample.surface[i], sample.side[i] == Side::Back)).or_insert(next);
            elements.push(Element {
                directions: point.straight_lobe(through).map(std::mem::take).unwrap_or_default(),
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
        error
    }
}
