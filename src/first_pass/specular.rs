//! Specular points: what each sees, in which directions, and where radiance goes from one to the next.

use super::form_factor::{plane_distances, projected_solid_angle};
use super::lobe::{Direction, Directions, LobeTable, directional_albedo, slope_spread, strip_order};
use super::normalise::{normalise_reflection, normalise_transmission};
use super::openings::openings;
use super::settings::Kernel;
use super::visibility_calls::facing_direction;
use crate::geometry::Side;
use crate::material::Transmission;
use crate::points::{NO_POINT, SamplePoints};
use crate::scene::SampledAppearance;
use crate::visibility::VisibilityGraph;
use glam::Vec3;
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
    /// Sample points seen, [`NO_POINT`] for a black cell; in the order of directions.
    pub members: Vec<u32>,
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
    albedo: Vec<f32>,
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
            albedo: directional_albedo(material.m),
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

/// Two unit vectors that make a frame with `normal`; the same for `normal` and `-normal`.
pub fn tangents(normal: Vec3) -> (Vec3, Vec3) {
    let axis = if normal.x.abs() < 0.6 { Vec3::X } else { Vec3::Y };
    let x = (axis - axis.dot(normal) * normal).normalize_or(Vec3::Z);
    let y = normal.cross(x);
    // cross(-n, x) = -cross(n, x): fix the sign by the first component that is not zero.
    let first = y.to_array().into_iter().find(|c| c.abs() > 1e-3).unwrap_or(1.0);
    (x, y * first.signum())
}

/// A member before it is sorted.
struct Member {
    point: u32,
    q_in: f32,
    q_out: f32,
    distance: f32,
    direction: Direction,
}

impl SpecularSet {
    /// Finds the specular points, what they see, and the scale factors of their lobes.
    pub fn new(
        points: &SamplePoints,
        graph: &VisibilityGraph,
        appearance: &SampledAppearance,
        kernel: Kernel,
        tolerance: f32,
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
            let mut members = visible(points, graph, kernel, tolerance, i);
            add_openings(points, i, &mut members);
            strip_order(&mut members, |m| m.direction.to);
            let directions: Vec<Direction> = members.iter().map(|m| m.direction).collect();
            let n2 = materials[material].as_ref().map_or(1.0, |m| m.n2);
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
                q_in: members.iter().map(|m| m.q_in).collect(),
                q_out: members.iter().map(|m| m.q_out).collect(),
                distance: if attenuates { members.iter().map(|m| m.distance).collect() } else { Vec::new() },
                reflection: Directions::new(&directions),
                transmission: twin.map(|_| outside(&directions, if inside(i) { n2 } else { 1.0 })),
                links,
            }
        };
        let mut set = SpecularSet {
            points: chosen.par_iter().map(build).collect(),
            materials,
            wavelengths: appearance.wavelengths.len(),
            closure_error: (0.0, 0.0),
            cells: 0,
        };
        set.connect();
        set.normalise();
        set.cells = set.points.iter().flat_map(|p| &p.members).filter(|&&m| m == NO_POINT).count() as u64;
        set
    }

    /// The material of a specular point.
    pub fn material(&self, point: &SpecularPoint) -> Option<&SpecularMaterial> {
        self.materials[point.material].as_ref()
    }

    /// Bands of wavelengths.
    pub fn bands(&self) -> usize {
        self.wavelengths.div_ceil(super::lobe::BAND)
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
    fn normalise(&mut self) {
        let materials = &self.materials;
        let mut errors: Vec<(f64, f64)> = self
            .points
            .par_iter_mut()
            .filter_map(|p| materials[p.material].as_ref().map(|m| (p, m)))
            .map(|(p, m)| normalise_reflection(&mut p.reflection, m.m2, &m.albedo))
            .collect();
        let pairs: Vec<(usize, usize)> = (self.points.iter().enumerate())
            .filter_map(|(s, p)| p.twin.map(|t| (s, t as usize)))
            .filter(|(s, t)| s < t)
            .collect();
        let scaled: Vec<_> = pairs
            .par_iter()
            .filter_map(|&(s, t)| {
                let mut a = self.points[s].transmission.clone()?;
                let mut b = self.points[t].transmission.clone()?;
                let error = normalise_transmission(&mut a, &mut b);
                Some((s, a, t, b, error))
            })
            .collect();
        for (s, a, t, b, error) in scaled {
            self.points[s].transmission = Some(a);
            self.points[t].transmission = Some(b);
            errors.push(error);
        }
        if !errors.is_empty() {
            let mean = errors.iter().map(|e| e.0).sum::<f64>() / errors.len() as f64;
            self.closure_error = (mean, errors.iter().map(|e| e.1).fold(0.0, f64::max));
        }
    }
}

/// All points that `i` sees, as members.
fn visible(
    points: &SamplePoints,
    graph: &VisibilityGraph,
    kernel: Kernel,
    tolerance: f32,
    i: usize,
) -> Vec<Member> {
    let analytic = kernel == Kernel::Analytic;
    let (x, y) = tangents(points.normal[i]);
    let mut members = Vec::new();
    for j in 0..points.len() {
        let (d_i, d_j, r2) = plane_distances(points, i, j);
        if !(d_i > tolerance && d_j > tolerance && graph.unblocked(i, j)) {
            continue;
        }
        let q_in = projected_solid_angle(points, i, j, analytic);
        members.push(Member {
            point: j as u32,
            q_in,
            q_out: projected_solid_angle(points, j, i, analytic),
            distance: r2.sqrt(),
            direction: Direction { weight: q_in, ..facing_direction(points, (i, j), (d_i, d_j, r2), (x, y)) },
        });
    }
    members
}

/// Adds the openings of the hemisphere of `i` as members without a point.
fn add_openings(points: &SamplePoints, i: usize, members: &mut Vec<Member>) {
    let (x, y) = tangents(points.normal[i]);
    let z = points.normal[i];
    let seen: f32 = members.iter().map(|m| m.q_in).sum();
    let local = |c: Vec3| {
        let d = c - points.position[i];
        Vec3::new(d.dot(x), d.dot(y), d.dot(z))
    };
    let found = openings(seen, members.iter().map(|m| points.corners[m.point as usize].map(local)));
    members.extend(found.into_iter().map(|opening| Member {
        point: NO_POINT,
        q_in: opening.weight,
        q_out: 0.0,
        distance: 0.0,
        direction: Direction {
            to: opening.to.to_array(),
            spread: slope_spread(opening.weight / opening.to.z, opening.to.z),
            blur: 0.0,
            weight: opening.weight,
        },
    }));
}

/// Directions inside a medium of index squared `n2` as the directions outside that refract into
/// them; those beyond the critical angle get no weight.
fn outside(directions: &[Direction], n2: f32) -> Directions {
    let n = n2.sqrt();
    let refracted: Vec<Direction> = directions
        .iter()
        .map(|d| {
            let [x, y, z] = d.to;
            let cos2 = 1.0 - n2 * (x * x + y * y);
            let cosine = if n2 == 1.0 { z } else { cos2.max(0.0).sqrt() };
            let weight = if cosine > 0.0 { n2 * d.weight } else { 0.0 };
            // dΩ outside is n² cos inside / cos outside times dΩ inside.
            let wider = n2 * z / cosine.max(0.1);
            Direction {
                to: [n * x, n * y, cosine],
                spread: d.spread * wider,
                blur: d.blur * wider.sqrt(),
                weight,
            }
        })
        .collect();
    Directions::new(&refracted)
}
