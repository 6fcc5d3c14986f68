//! Are bicubic patches right where another shape, or a closed form, says what is right?

use crate::furnace;
use glam::{DVec2, DVec3};
use luxgraph::geometry::{Patch, Ray, Round, Shape, Sphere};
use luxgraph::observer::Silent;
use luxgraph::scene::{Geometry, ObjectId, Scene};
use luxgraph::settings::Settings;
use luxgraph::tracers::brute_force::intersect_surface;
use luxgraph::tracers::{TracerChoice, choose};
use luxgraph::{pipeline, scene};
use std::f64::consts::PI;

type Net = [[DVec3; 4]; 4];

struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn place(&mut self) -> DVec3 {
        DVec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }
}

/// The control points of the patch that passes through these places at thirds of u and v.
fn through(places: Net) -> Net {
    let curve = |[a, b, c, d]: [DVec3; 4]| {
        let first = (-5.0 * a + 18.0 * b - 9.0 * c + 2.0 * d) / 6.0;
        let second = (2.0 * a - 9.0 * b + 18.0 * c - 5.0 * d) / 6.0;
        [a, first, second, d]
    };
    let rows = places.map(curve);
    let columns: Net = std::array::from_fn(|i| curve(std::array::from_fn(|j| rows[j][i])));
    std::array::from_fn(|j| std::array::from_fn(|i| columns[i][j]))
}

/// Six patches that all but are the sphere of radius 1 about zero, outside in front, or inside.
fn ball(inward: bool) -> Vec<Net> {
    let face = |axis: usize, sign: f64| {
        let n = sign * DVec3::AXES[axis];
        let x = DVec3::AXES[(axis + 1) % 3];
        let y = if inward { x.cross(n) } else { n.cross(x) };
        // Even steps of the angle, so that no part is much larger than another.
        let along = |k: usize| ((k as f64 / 3.0 - 0.5) * 0.5 * PI).tan();
        through(std::array::from_fn(|j| {
            std::array::from_fn(|i| (n + along(i) * x + along(j) * y).normalize())
        }))
    };
    (0..6).map(|k| face(k / 2, if k % 2 == 0 { 1.0 } else { -1.0 })).collect()
}

fn written(nets: &[Net]) -> String {
    let nets: Vec<_> = nets.iter().map(|net| net.map(|row| row.map(|p| p.to_array()))).collect();
    format!("patches = {nets:?}\n")
}

fn load(text: &str) -> Result<Scene, String> {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let path = folder.path().join("s.toml");
    std::fs::write(&path, format!("format = 1\n{text}")).expect("written");
    scene::load(&path).map_err(|e| e.to_string())
}

#[test]
fn a_flat_patch_is_its_quadrilateral() {
    let corners = [[-1.0, -0.5, 0.2], [1.0, -0.5, 0.4], [1.0, 0.5, 0.4], [-1.0, 0.5, 0.2]].map(DVec3::from);
    let [a, b, c, d] = corners;
    // Control points crowded along one way and then the other: the same plane, another (u, v).
    for bend in [1.0, 0.6, 1.7] {
        let at = |k: usize| (k as f64 / 3.0).powf(bend);
        let net =
            std::array::from_fn(|j| std::array::from_fn(|i| a.lerp(b, at(i)).lerp(d.lerp(c, at(i)), at(j))));
        let patch = Round::from(Patch::new(net));
        let quad = Geometry::new(vec![(Shape::Quad(corners), false, 0, ObjectId(0))], vec!["quad".into()]);
        let centre = quad.centre;
        assert!((patch.area() / quad.surfaces[0].area - 1.0).abs() < 1e-9, "{}", patch.area());
        let mut random = Random(7);
        let mut hits = 0;
        for _ in 0..20_000 {
            let (origin, towards) = (2.0 * random.place(), random.place());
            let ray = Ray { origin, direction: towards - origin, t_min: 0.0, t_max: 10.0 };
            let found = patch.intersect(&ray);
            let expected = intersect_surface(&Ray { origin: origin - centre, ..ray }, &quad.surfaces[0]);
            match (found, expected) {
                (Some(t), Some(s)) => assert!((t - s).abs() < 1e-7, "{t} {s}"),
                (t, s) => assert_eq!(t.is_some(), s.is_some(), "{ray:?}"),
            }
            hits += u32::from(found.is_some());
        }
        assert!(hits > 2000, "{hits}");
    }
}

#[test]
fn six_patches_near_a_sphere_have_its_area_and_its_hits() {
    let patches: Vec<Round> = ball(false).into_iter().map(|net| Patch::new(net).into()).collect();
    // How far they are from the sphere is known from their places; area and hits can be no further off.
    let mut off = 0.0f64;
    for patch in &patches {
        for k in 0..41 * 41 {
            let p = patch.point_at(f64::from(k % 41) / 40.0, f64::from(k / 41) / 40.0);
            off = off.max((p.length() - 1.0).abs());
        }
    }
    assert!(off > 1e-5 && off < 0.01, "{off}");
    let area: f64 = patches.iter().map(Round::area).sum();
    assert!((area / (4.0 * PI) - 1.0).abs() < 2.0 * off, "{area} {off}");
    let sphere = Round::Sphere(Sphere { centre: DVec3::ZERO, radius: 1.0, inward: false });
    let mut random = Random(3);
    let (mut hits, mut worst) = (0, 0.0f64);
    for _ in 0..20_000 {
        let (origin, towards) = (3.0 * random.place(), 0.9 * random.place());
        let direction = (towards - origin).normalize();
        let ray = Ray { origin, direction, t_min: 0.0, t_max: 100.0 };
        let found = patches.iter().filter_map(|patch| patch.intersect(&ray)).fold(f64::INFINITY, f64::min);
        let beside = origin.cross(direction).length();
        // Lines that come near a tangent may meet one and not the other.
        if (beside - 1.0).abs() < 0.05 || (origin.length() - 1.0).abs() < 0.05 {
            continue;
        }
        let expected = sphere.intersect(&ray).unwrap_or(f64::INFINITY);
        assert_eq!(found.is_finite(), expected.is_finite(), "{ray:?}: {found} {expected}");
        if found.is_finite() {
            let cosine = (1.0 - beside * beside).sqrt();
            worst = worst.max((found - expected).abs() * cosine);
            let p = ray.at(found);
            let distance = |patch: &&Round| patch.distance(p).abs();
            let patch = patches.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).expect("six");
            // The normal is that of the patch, by differences of its places, and so all but that of the sphere.
            let uv = patch.uv_of(p).clamp(DVec2::splat(1e-4), DVec2::splat(1.0 - 1e-4));
            let at = |u: f64, v: f64| patch.point_at(uv.x + 1e-4 * u, uv.y + 1e-4 * v);
            let normal = (at(1.0, 0.0) - at(-1.0, 0.0)).cross(at(0.0, 1.0) - at(0.0, -1.0)).normalize();
            assert!(distance(&patch) < 1e-9 && patch.normal_at(p).dot(normal) > 1.0 - 1e-6, "{ray:?}");
            assert!(normal.dot(p.normalize()) > 0.99, "{ray:?} {normal}");
            hits += 1;
        }
    }
    assert!(hits > 5000 && worst < 1.1 * off, "{hits} {worst} {off}");
}

#[test]
fn no_line_slips_between_patches_of_a_closed_body() {
    // From inside all is met, whatever seam a line passes.
    let patches: Vec<Round> = ball(true).into_iter().map(|net| Patch::new(net).into()).collect();
    let mut random = Random(11);
    for k in 0..60_000 {
        let origin = 0.5 * random.place();
        let (u, v) = (random.unit(), random.unit());
        // At places of the seams, too, and at corners, as near as numbers say.
        let (u, v) = [(u, v), (0.0, v), (u, 1.0), (1.0, 1.0), (0.5, v), (0.25, 0.75)][k % 6];
        let direction = patches[k % 5].point_at(u, v) - origin;
        let ray = Ray { origin, direction, t_min: 0.0, t_max: f64::INFINITY };
        assert!(patches.iter().any(|patch| patch.intersect(&ray).is_some()), "{k}: {ray:?}");
    }
}

#[test]
fn a_furnace_with_patches_is_one_even_picture() {
    // A room that is a ball of patches, and in it another, an open bowl and a cap that runs to a point.
    let moved = |nets: Vec<Net>, size: f64, to: DVec3| -> Vec<Net> {
        nets.into_iter().map(|net| net.map(|row| row.map(|p| size * p + to))).collect()
    };
    let room = written(&moved(ball(true), 2.0, DVec3::ZERO));
    let body = written(&moved(ball(false), 0.5, DVec3::new(0.3, 0.4, 0.1)));
    let at = |i: usize, j: usize| {
        let (u, v) = (i as f64 / 3.0 - 0.5, j as f64 / 3.0);
        DVec3::new(-0.7 + 0.8 * u * v, 0.5, -0.6 + 0.7 * v) + DVec3::Y * (0.9 * u * u * v)
    };
    let cap = written(&[std::array::from_fn(|j| std::array::from_fn(|i| at(i, j)))]);
    let wears = "reflectance = 0.7\nemission = { spectrum = 1.0, radiance = 3.0 }\n";
    let scene = load(&format!(
        "[sampling]\nmax_area = 0.08\n[materials.wall]\n{wears}[materials.both]\n{wears}two_sided = true\n\
         [[objects]]\nname = \"room\"\nmaterial = \"wall\"\n{room}\
         [[objects]]\nname = \"body\"\nmaterial = \"wall\"\nmax_area = 0.01\n{body}\
         [[objects]]\nname = \"cap\"\nmaterial = \"both\"\nmax_area = 0.005\n{cap}\
         [[cameras]]\nname = \"main\"\nposition = [0.1, -1.6, 0.2]\ntarget = [0, 0.4, 0.1]\nfov_deg = 100\n\
         resolution = [64, 64]\n"
    ))
    .expect("loads");
    furnace::is_even(&scene, 10.0);
}

#[test]
fn a_glowing_ball_of_patches_lights_as_a_sphere_does() {
    // E = π L (r / d)² sin² for a ball all of which is above the horizon: here the sensor looks at it.
    let ball = ball(false).into_iter().map(|net| net.map(|row| row.map(|p| 0.25 * p))).collect::<Vec<_>>();
    let scene = load(&format!(
        "[sampling]\nmax_area = 0.004\n[materials.lamp]\nemission = {{ spectrum = 1.0, radiance = 2.0 }}\n\
         [[objects]]\nname = \"lamp\"\nmaterial = \"lamp\"\n{}\
         [[sensors]]\nname = \"towards it\"\nposition = [1, 0.3, 0.2]\nnormal = [-1, -0.3, -0.2]\n\
         [[cameras]]\nname = \"main\"\nposition = [2, 0, 0]\ntarget = [0, 0, 0]\n",
        written(&ball)
    ))
    .expect("loads");
    let settings = Settings::default();
    let tracer = choose(TracerChoice::Auto, &scene.geometry).unwrap();
    let (geometry, tracer) = (&scene.geometry, tracer.as_ref());
    let prepared = pipeline::prepare(geometry, &scene.sampling, &settings, tracer, None, &Silent).unwrap();
    let lit = pipeline::light(geometry, &prepared, &scene.appearance, &settings, &Silent).unwrap();
    let read =
        pipeline::measure(geometry, &prepared, &lit, &scene.sensors, tracer, &settings.measure, &Silent)
            .unwrap();
    let expected = PI * 2.0 * 0.25f64.powi(2) / (1.0 + 0.09 + 0.04);
    for found in read[0].total() {
        assert!((found / expected - 1.0).abs() < 0.01, "{found} for {expected}");
    }
}

#[test]
fn what_is_no_patch_is_refused_where_it_stands() {
    let object = |points: &str| {
        let text = format!(
            "[materials.m]\nreflectance = 0.5\n[[objects]]\nname = \"o\"\nmaterial = \"m\"\npatches = [{points}]\n\
             [[cameras]]\nname = \"c\"\nposition = [0, -1, 3]\ntarget = [0, 0, 0]\n"
        );
        load(&text).err().unwrap_or_default()
    };
    let row = |y: f64| format!("[[0, {y:?}, 0], [1, {y:?}, 0], [2, {y:?}, 0], [3, {y:?}, 0]]");
    let rows = |ys: [f64; 4]| format!("[{}]", ys.map(row).join(", "));
    assert_eq!(object(&rows([0.0, 1.0, 2.0, 3.0])), "");
    assert!(object(&rows([0.0; 4])).contains("too small"), "all in a line: {}", object(&rows([0.0; 4])));
    assert!(object(&rows([0.0, 1.0, f64::INFINITY, 3.0])).contains("finite"));
    assert!(object(&rows([0.0, 1.0, 1e30, 3.0])).contains("1e18"));
    assert!(!object("[[[0, 0, 0]]]").is_empty());
}
