//! Where light is measured.

use glam::DVec3;

/// A plane element that receives light from the half space in front of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensor {
    /// Its name in the scene file.
    pub name: String,
    /// Where it is, world, m.
    pub position: DVec3,
    /// Which way it looks, unit.
    pub normal: DVec3,
}

/// Sensors in rows over a parallelogram, each in the middle of its cell.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Its name in the scene file.
    pub name: String,
    /// A corner, world, m.
    pub origin: DVec3,
    /// The edge along which the first index counts, m.
    pub u: DVec3,
    /// The edge along which the second index counts, m.
    pub v: DVec3,
    /// Cells along `u` and `v`, at least one each.
    pub counts: [u32; 2],
    /// Which way all of its sensors look, unit.
    pub normal: DVec3,
    /// How far the sensors are lifted along the normal, m.
    pub offset: f64,
}

impl Grid {
    /// Number of sensors.
    pub fn len(&self) -> usize {
        self.counts[0] as usize * self.counts[1] as usize
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The sensors, the first index fastest: number `j counts[0] + i` is cell (i, j).
    pub fn sensors(&self) -> impl Iterator<Item = Sensor> + '_ {
        let [nu, nv] = self.counts;
        (0..nv).flat_map(move |j| (0..nu).map(move |i| (i, j))).map(move |(i, j)| {
            let share = |k: u32, n: u32| (f64::from(k) + 0.5) / f64::from(n);
            let place = self.origin + share(i, nu) * self.u + share(j, nv) * self.v;
            Sensor {
                name: self.name.clone(),
                position: place + self.offset * self.normal,
                normal: self.normal,
            }
        })
    }
}
