//! The nodes between elements: corners of cells and middles of their edges, found exactly through
//! integer coordinates, across levels of the quadtree and across the surfaces of one patch.

use crate::geometry::{Round, Shape, Side, Surface};
use crate::points::{Cell, SamplePoints};
use crate::scene::Geometry;
use glam::{DVec2, DVec3};
use std::collections::{HashMap, HashSet};

/// Lattice steps along a whole edge of a surface: one level finer than the deepest cell, so that
/// the middles of its edges are on the lattice too.
const UNIT: u32 = 1 << (Cell::MAX_LEVEL + 1);

/// Lattice coordinates, (u, v) in units of 1 / [`UNIT`].
type Place = [u32; 2];

/// What tells a node from all others. Vertices are numbered per patch and side, so that the
/// surfaces of a patch share the nodes of their common edges and no others do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Key {
    /// A vertex of a surface.
    Vertex(u32),
    /// On the edge between two vertices, the lower first; the steps from it.
    Edge(u32, u32, u32),
    /// Inside a surface's side.
    Inside(u32, Place),
}

/// Nodes and how elements hang on them. Element `i` is that of sample point `i`.
pub(super) struct Lattice {
    /// Where each node is, local coordinates, m.
    pub position: Vec<DVec3>,
    /// Nodes that are the mean of two others, because the edge they halve is part of a larger
    /// element's: `(node, a, b)`, by node.
    pub halves: Vec<(u32, u32, u32)>,
    /// Elements that touch each node, at a corner or along an edge; increasing.
    pub touching: Lists,
    /// Nodes on each element's border, counter-clockwise in (u, v), from the first corner.
    pub border: Lists,
    /// (u, v) of each of these nodes as its element has it, in lattice coordinates.
    border_place: Vec<Place>,
    /// Corner nodes of each element; a triangle's last is repeated.
    pub corners: Vec<[u32; 4]>,
    /// Whether the border is corner, middle, corner, middle and so on.
    pub regular: Vec<bool>,
}

/// Lists of numbers, one after the other.
pub(super) struct Lists {
    starts: Vec<u32>,
    items: Vec<u32>,
}

impl Lists {
    /// List `i`.
    #[inline]
    pub fn of(&self, i: usize) -> &[u32] {
        &self.items[self.starts[i] as usize..self.starts[i + 1] as usize]
    }

    /// All lists.
    #[inline(always)]
    pub fn all(&self) -> &[u32] {
        &self.items
    }

    /// Where list `i` lies among all items.
    #[inline]
    pub fn range(&self, i: usize) -> std::ops::Range<usize> {
        self.starts[i] as usize..self.starts[i + 1] as usize
    }

    /// From pairs (list, item); within a list the order of the pairs is kept.
    fn from_pairs(lists: usize, pairs: &[(u32, u32)]) -> Self {
        let mut starts = vec![0u32; lists + 1];
        for (list, _) in pairs {
            starts[*list as usize + 1] += 1;
        }
        for i in 0..lists {
            starts[i + 1] += starts[i];
        }
        let mut next = starts.clone();
        let mut items = vec![0; pairs.len()];
        for &(list, item) in pairs {
            items[next[list as usize] as usize] = item;
            next[list as usize] += 1;
        }
        Lists { starts, items }
    }
}

/// Surface and side as one number.
pub(super) fn sheet(surface: usize, side: Side) -> usize {
    2 * surface + side as usize
}

/// The nodes while they are being found.
struct Builder<'a> {
    geometry: &'a Geometry,
    /// Numbers of the vertices of each sheet.
    vertices: Vec<[u32; 4]>,
    corners: HashMap<Key, u32>,
    middles: HashMap<Key, u32>,
    /// Pieces of larger elements' edges, by the key of their middle.
    pieces: HashSet<Key>,
    position: Vec<DVec3>,
}

impl Lattice {
    /// Finds all nodes of the elements of `points`.
    pub fn new(geometry: &Geometry, points: &SamplePoints) -> Self {
        let mut builder = Builder {
            geometry,
            vertices: number_vertices(geometry),
            corners: HashMap::new(),
            middles: HashMap::new(),
            pieces: HashSet::new(),
            position: Vec::new(),
        };
        let n = points.len();
        let places: Vec<[Place; 4]> = (0..n)
            .map(|i| {
                let corners = points.cell[i].corners_uv(&geometry.surface(points.surface[i]).shape);
                corners.map(|c| [(c.x * f64::from(UNIT)) as u32, (c.y * f64::from(UNIT)) as u32])
            })
            .collect();
        let owner = |i: usize| (points.surface[i].index(), points.side[i]);
        let corners: Vec<[u32; 4]> =
            (0..n).map(|i| places[i].map(|place| builder.corner(owner(i), place))).collect();

        let (mut border, mut border_place) = (Vec::new(), Vec::new());
        let mut middles: Vec<(u32, u32, u32, Key)> = Vec::new();
        let mut regular = Vec::with_capacity(n);
        for i in 0..n {
            let (surface, side) = owner(i);
            let sides = if matches!(geometry.surfaces[surface].shape, Shape::Triangle(_)) { 3 } else { 4 };
            let mut even = sides == 4;
            for k in 0..sides {
                let mut edge = vec![(corners[i][k], places[i][k])];
                builder.divide((surface, side), places[i][k], places[i][(k + 1) % sides], &mut edge);
                edge.push((corners[i][(k + 1) % sides], places[i][(k + 1) % sides]));
                border.push((i as u32, edge[0].0));
                border_place.push(edge[0].1);
                if edge.len() == 2 {
                    let middle = between(edge[0].1, edge[1].1);
                    let key = builder.key((surface, side), middle);
                    let node = builder.middle((surface, side), middle, key);
                    border.push((i as u32, node));
                    border_place.push(middle);
                    middles.push((node, edge[0].0, edge[1].0, key));
                } else {
                    even &= edge.len() == 3;
                    border.extend(edge[1..edge.len() - 1].iter().map(|(node, _)| (i as u32, *node)));
                    border_place.extend(edge[1..edge.len() - 1].iter().map(|(_, place)| *place));
                    for pair in edge.windows(2) {
                        let key = builder.key((surface, side), between(pair[0].1, pair[1].1));
                        builder.pieces.insert(key);
                    }
                }
            }
            regular.push(even);
        }

        let mut halves: Vec<_> = middles
            .iter()
            .filter(|(.., key)| builder.pieces.contains(key))
            .map(|&(node, a, b, _)| (node, a, b))
            .collect();
        halves.sort_unstable();
        let mut touching: Vec<(u32, u32)> = border.iter().map(|&(element, node)| (node, element)).collect();
        touching.dedup();
        Lattice {
            halves,
            touching: Lists::from_pairs(builder.position.len(), &touching),
            border: Lists::from_pairs(n, &border),
            border_place,
            corners,
            regular,
            position: builder.position,
        }
    }

    /// (u, v) of the nodes on the border of an element, as it has them.
    pub fn border_uv(&self, element: usize) -> impl Iterator<Item = DVec2> {
        self.border_place[self.border.range(element)].iter().map(|&place| uv_of(place))
    }

    /// The element and all that touch it; increasing.
    pub fn around(&self, element: usize) -> Vec<u32> {
        let border = self.border.of(element);
        let mut around: Vec<u32> =
            border.iter().flat_map(|&node| self.touching.of(node as usize).iter().copied()).collect();
        around.sort_unstable();
        around.dedup();
        around
    }

    /// The two nodes that `node` is the mean of, if it is a half.
    pub fn halved(&self, node: u32) -> Option<[u32; 2]> {
        let at = self.halves.binary_search_by_key(&node, |(half, ..)| *half).ok()?;
        let (_, a, b) = self.halves[at];
        Some([a, b])
    }
}

impl Builder<'_> {
    /// The node at a corner of an element.
    fn corner(&mut self, owner: (usize, Side), place: Place) -> u32 {
        let key = self.key(owner, place);
        let position = &mut self.position;
        *self.corners.entry(key).or_insert_with(|| add(position, self.geometry, owner.0, place))
    }

    /// The node in the middle of an undivided edge.
    fn middle(&mut self, owner: (usize, Side), place: Place, key: Key) -> u32 {
        let position = &mut self.position;
        *self.middles.entry(key).or_insert_with(|| add(position, self.geometry, owner.0, place))
    }

    /// The corners of smaller neighbours strictly between `a` and `b`, in order. Where there is
    /// any there is one in the middle, for the neighbours come from a quadtree.
    fn divide(&self, owner: (usize, Side), a: Place, b: Place, found: &mut Vec<(u32, Place)>) {
        let middle = between(a, b);
        // An edge without length is one node.
        let collapsed = || self.key(owner, a) == self.key(owner, b);
        if middle == a || middle == b || collapsed() {
            return;
        }
        if let Some(&node) = self.corners.get(&self.key(owner, middle)) {
            self.divide(owner, a, middle, found);
            found.push((node, middle));
            self.divide(owner, middle, b, found);
        }
    }

    fn key(&self, (surface, side): (usize, Side), place: Place) -> Key {
        let v = &self.vertices[sheet(surface, side)];
        let edge = |a: u32, b: u32, steps: u32| match steps {
            0 => Key::Vertex(a),
            UNIT => Key::Vertex(b),
            _ if a < b => Key::Edge(a, b, steps),
            _ => Key::Edge(b, a, UNIT - steps),
        };
        match (&self.geometry.surfaces[surface].shape, place) {
            (Shape::Round(Round::Patch(patch)), _) => {
                let [low_v, high_u, high_v, low_u] = patch.collapsed();
                match place {
                    [_, 0] if low_v => Key::Vertex(v[0]),
                    [UNIT, _] if high_u => Key::Vertex(v[1]),
                    [_, UNIT] if high_v => Key::Vertex(v[2]),
                    [0, _] if low_u => Key::Vertex(v[0]),
                    [i, 0] => edge(v[0], v[1], i),
                    [UNIT, j] => edge(v[1], v[2], j),
                    [i, UNIT] => edge(v[3], v[2], i),
                    [0, j] => edge(v[0], v[3], j),
                    _ => Key::Inside(sheet(surface, side) as u32, place),
                }
            }
            (Shape::Round(round), _) => Key::Inside(sheet(surface, side) as u32, folded(round, place)),
            (_, [i, 0]) => edge(v[0], v[1], i),
            (Shape::Quad(_), [UNIT, j]) => edge(v[1], v[2], j),
            (Shape::Quad(_), [i, UNIT]) => edge(v[3], v[2], i),
            (Shape::Quad(_), [0, j]) => edge(v[0], v[3], j),
            (Shape::Triangle(_), [0, j]) => edge(v[0], v[2], j),
            (Shape::Triangle(_), [i, j]) if i + j == UNIT => edge(v[1], v[2], j),
            _ => Key::Inside(sheet(surface, side) as u32, place),
        }
    }
}

/// The one of several places of a square that are one place in space. Each edge of a sphere's folds onto itself about its
/// middle, and so all four corners are one pole; the first and the last edge of a cone's are one line, and its edge
/// without length is one point.
fn folded(round: &Round, [i, j]: Place) -> Place {
    let ends = |x: u32| x == 0 || x == UNIT;
    match round {
        Round::Disc(_) | Round::Patch(_) => [i, j],
        Round::Sphere(_) => match (ends(i), ends(j)) {
            (true, true) => [0, 0],
            (true, false) => [i, j.min(UNIT - j)],
            (false, true) => [i.min(UNIT - i), j],
            (false, false) => [i, j],
        },
        Round::Cone(cone) => {
            let is_apex = j == 0 && cone.radius == 0.0 || j == UNIT && cone.top_radius == 0.0;
            [if is_apex { 0 } else { i % UNIT }, j]
        }
    }
}

fn between(a: Place, b: Place) -> Place {
    [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]
}

fn uv_of([i, j]: Place) -> DVec2 {
    DVec2::new(f64::from(i), f64::from(j)) / f64::from(UNIT)
}

fn add(position: &mut Vec<DVec3>, geometry: &Geometry, surface: usize, place: Place) -> u32 {
    let uv = uv_of(place);
    position.push(geometry.surfaces[surface].point_at(uv.x, uv.y));
    (position.len() - 1) as u32
}

/// Numbers the vertices of every sheet; the same place has the same number within a patch's side.
fn number_vertices(geometry: &Geometry) -> Vec<[u32; 4]> {
    let mut numbers: HashMap<(u32, Side, [u64; 3]), u32> = HashMap::new();
    let mut vertices = Vec::with_capacity(2 * geometry.surfaces.len());
    let number = |surface: &Surface, patch: u32, side: Side, numbers: &mut HashMap<_, u32>| {
        let mut of = [0; 4];
        let corners = match surface.round() {
            Some(Round::Patch(patch)) => {
                let net = patch.net();
                vec![net[0][0], net[0][3], net[3][3], net[3][0]]
            }
            _ => surface.vertices().to_vec(),
        };
        for (number, v) in of.iter_mut().zip(&corners) {
            let next = numbers.len() as u32;
            // Adding zero makes -0 and 0 the same place.
            *number = *numbers.entry((patch, side, (*v + 0.0).to_array().map(f64::to_bits))).or_insert(next);
        }
        of
    };
    for (surface, &patch) in geometry.surfaces.iter().zip(&geometry.patch) {
        vertices.push(number(surface, patch, Side::Front, &mut numbers));
        vertices.push(number(surface, patch, Side::Back, &mut numbers));
    }
    vertices
}
