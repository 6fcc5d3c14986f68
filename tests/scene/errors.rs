//! Does every mistake in a scene file give an error with its place and a remedy?

use crate::folder::Folder;
use luxgraph::error::Error;
use luxgraph::scene::{Scene, SceneDescription, load};

const SCENE: &str = r#"format = 1
[materials.grey]
reflectance = 0.5
[[objects]]
name = "floor"
material = "grey"
quads = [[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]]
[[cameras]]
name = "main"
position = [0, 0, 3]
target = [1, 1, 0]
"#;

fn read(content: impl AsRef<[u8]>) -> Result<Scene, Error> {
    let folder = Folder::new();
    load(&folder.write("scene.toml", content))
}

/// Line, column and message of the error.
fn place(result: Result<impl Sized, Error>) -> (usize, usize, String) {
    match result {
        Err(Error::Scene { line, column, message, .. }) => (line, column, message),
        Err(other) => panic!("not a scene error: {other}"),
        Ok(_) => panic!("accepted"),
    }
}

#[test]
fn the_scene_itself_is_right() {
    assert_eq!(read(SCENE).expect("loads").geometry.surfaces.len(), 1);
    assert!(read(format!("\u{feff}{SCENE}")).is_ok(), "a byte order mark is no mistake");
}

/// (what is replaced, by what, line, word of the message)
#[test]
fn mistakes_are_located() {
    let cases: &[(&str, &str, usize, &str)] = &[
        ("format = 1", "format = 2", 1, "format = 1"),
        ("format = 1\n", "", 1, "`format` is missing"),
        ("reflectance = 0.5", "reflectanse = 0.5", 3, "did you mean `reflectance`"),
        ("reflectance = 0.5", "reflectance = [1]", 3, "a spectrum or a number"),
        ("reflectance = 0.5", "reflectance = 1.5", 3, "0 to 1"),
        ("reflectance = 0.5", "reflectance = nan", 3, "0 to 1"),
        ("reflectance = 0.5", "reflectance = \"gren\"", 3, "did you mean \"green\""),
        ("reflectance = 0.5", "", 2, "says nothing about light"),
        ("reflectance = 0.5", "reflectance = 0.5\nspecular = 1.1", 4, "0 to 1"),
        ("reflectance = 0.5", "reflectance = 0.5\nspecular = 0.5", 4, "fresnel"),
        ("reflectance = 0.5", "reflectance = 0.5\nroughness = -1", 4, "0 to 2"),
        ("reflectance = 0.5", "reflectance = 0.5\nroughness = 2.1", 4, "0 to 2"),
        ("reflectance = 0.5", "fresnel = \"glod\"", 3, "did you mean \"gold\""),
        ("reflectance = 0.5", "fresnel = { k = 1.0 }", 3, "one of"),
        ("reflectance = 0.5", "pane = { index = 1.5 }\nspecular = 1", 4, "glass takes no"),
        ("reflectance = 0.5", "solid = { index = 1.5, over_m = 1 }", 3, "together with"),
        ("reflectance = 0.5", "emission = { illuminant = \"D66\", luminance = 1 }", 3, "D65"),
        ("reflectance = 0.5", "emission = { illuminant = \"D65\" }", 3, "luminous_flux"),
        ("reflectance = 0.5", "emission = { spectrum = 1, luminance = -1 }", 3, "0 to 1e15"),
        ("material = \"grey\"", "material = \"gray\"", 6, "did you mean \"grey\""),
        ("material = \"grey\"\n", "", 4, "no `material`"),
        ("material = \"grey\"", "material = \"grey\"\nmax_area = 0", 7, "positive"),
        ("[1, 1, 0], [0, 1", "[0.2, 0.2, 0], [0, 1", 7, "not convex: corner 3"),
        ("[1, 1, 0], [0, 1", "[0.5, 0.5, 0], [0, 1", 7, "not convex: corner 3"),
        ("[1, 1, 0], [0, 1", "[1, 0, 0], [0, 1", 7, "not convex"),
        ("[1, 1, 0], [0, 1, 0]", "[2, 0, 0], [3, 0, 0]", 7, "no area"),
        ("[1, 1, 0], [0, 1", "[inf, 1, 0], [0, 1", 7, "finite"),
        ("[1, 1, 0], [0, 1", "[2e18, 1, 0], [0, 1", 7, "1e18"),
        (", [0, 1, 0]]]", "]]", 7, "4"),
        ("quads = [[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]]", "", 4, "`obj`"),
        (
            "quads",
            "discs = [{ centre = [0, 0, 1], normal = [0, 0, 0], radius = 1 }]\nquads",
            7,
            "cannot be zero",
        ),
        (
            "quads",
            "discs = [{ centre = [0, 0, 1], normal = [0, 0, 1], radius = 0 }]\nquads",
            7,
            "a radius is",
        ),
        ("quads", "discs = [{ centre = [0, 0, 1], radius = 1 }]\nquads", 7, "`normal` is missing"),
        ("quads", "spheres = [{ centre = [0, 0, 1], radius = -1 }]\nquads", 7, "a radius is"),
        ("quads", "spheres = [{ centre = [0, 0, 1], radius = nan }]\nquads", 7, "a radius is"),
        ("quads", "spheres = [{ centre = [0, inf, 1], radius = 1 }]\nquads", 7, "the centre of a sphere"),
        ("quads", "spheres = [{ centre = [1e18, 0, 1], radius = 1e17 }]\nquads", 7, "beyond 1e18"),
        ("quads", "spheres = [{ centre = [0, 0, 1], radius = 1e-6 }]\nquads", 7, "too small"),
        ("quads", "spheres = [{ center = [0, 0, 1], radius = 1 }]\nquads", 7, "did you mean `centre`"),
        ("quads", "sphere = [{ centre = [0, 0, 1], radius = 1 }]\nquads", 7, "did you mean `spheres`"),
        ("position = [0, 0, 3]", "position = [1, 1, 0]", 11, "another place"),
        ("position = [0, 0, 3]", "position = [1, 1, 3]", 11, "`up`"),
        ("target = [1, 1, 0]", "target = [1, 1, 0]\nfov_deg = 180", 12, "between 0 and 180"),
        ("target = [1, 1, 0]", "target = [1, 1, 0]\nresolution = [0, 1]", 12, "65536"),
        ("target = [1, 1, 0]", "target = [1, 1, 0]\nresolution = [65536, 65536]", 12, "pixels together"),
        ("[materials.grey]", "[sampling]\nmax_area = -1\n[materials.grey]", 3, "positive"),
        ("[materials.grey]", "[sampling]\nmax_area = 1e-9\n[materials.grey]", 3, "raise max_area"),
        ("[materials.grey]", "[sampling]\nmax_level = 17\n[materials.grey]", 3, "at most 16"),
        ("[materials.grey]", "[spectra.s]\nfile = \"no.csv\"\n[materials.grey]", 3, "cannot read"),
        ("[materials.grey]", "[spectra.s]\n[materials.grey]", 2, "given by"),
        (
            "[materials.grey]",
            "[spectra.s]\nwavelengths_nm = [500, 400]\nvalues = [1, 2]\n[materials.grey]",
            4,
            "increas",
        ),
    ];
    for (old, new, line, word) in cases {
        assert!(SCENE.contains(old), "{old}");
        let (l, column, message) = place(read(SCENE.replacen(old, new, 1)));
        assert_eq!(l, *line, "{new}: column {column}: {message}");
        assert!(message.contains(word), "{new}: {message}");
    }
}

#[test]
fn names_are_unique_and_cameras_and_surfaces_exist() {
    let camera = &SCENE[SCENE.find("[[cameras]]").expect("there")..];
    assert!(place(read(format!("{SCENE}{camera}"))).2.contains("two cameras"));
    let framed = read(SCENE.replace(camera, "")).expect("a camera is found");
    assert_eq!(framed.cameras.len(), 1);
    assert!(framed.notes.iter().any(|n| n.contains("no camera")), "{:?}", framed.notes);
    let object = &SCENE[SCENE.find("[[objects]]").expect("there")..SCENE.find("[[cameras]]").expect("there")];
    assert!(place(read(format!("{SCENE}{object}"))).2.contains("two objects"));
    assert!(place(read(SCENE.replace(object, ""))).2.contains("no surface"));
}

#[test]
fn files_that_are_no_scene_are_refused_kindly() {
    let folder = Folder::new();
    assert!(place(read("")).2.contains("format"));
    assert_eq!(place(read("format = 1\n[[objects]\n")).0, 2);
    assert_eq!(place(read(b"format = 1\n# \xe9\xff")), (2, 3, place(read(b"format = 1\n# \xe9\xff")).2));
    assert!(matches!(load(&folder.path().join("none.toml")), Err(Error::Io { .. })));
    match load(folder.path()) {
        Err(Error::Io { message, .. }) => assert!(message.contains("directory"), "{message}"),
        other => panic!("{other:?}"),
    }
}

#[test]
fn changes_that_need_other_points_are_refused() {
    let folder = Folder::new();
    let path = folder.write("scene.toml", SCENE);
    let description = SceneDescription::read(&path).expect("reads");
    let geometry = description.compile().expect("compiles").geometry;
    let try_changes = |text: &str| {
        let changes = folder.write("c.toml", text);
        description.changed(&changes).and_then(|d| d.appearance(&geometry))
    };
    let bright = try_changes("format = 1\n[materials.grey]\nreflectance = 0.9\n").expect("allowed");
    assert_ne!(bright.materials, description.compile().expect("compiles").appearance.materials);
    for text in [
        "format = 1\n[materials.grey]\npane = { index = \"bk7\" }\n",
        "format = 1\n[materials.grey]\ntwo_sided = true\n",
    ] {
        let (line, _, message) = place(try_changes(text));
        assert_eq!(line, 3);
        assert!(message.contains("two_sided = true"), "{message}");
    }
    let (line, _, message) = place(try_changes("format = 1\n[materials.gray]\nreflectance = 0.9\n"));
    assert_eq!(line, 2);
    assert!(message.contains("did you mean \"grey\""), "{message}");
    let (line, _, message) = place(try_changes("format = 1\n[assign]\nflor = \"grey\"\n"));
    assert_eq!(line, 3);
    assert!(message.contains("did you mean \"floor\""), "{message}");
    assert!(place(try_changes("format = 1\n[[cameras]]\n")).2.contains("unknown key `cameras`"));
}

#[test]
fn obj_objects_and_materials_arrive() {
    let folder = Folder::new();
    let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 1 1 0.1\nv 2 0 0\n";
    folder.write("m.obj", format!("{square}o top\nusemtl Grey\nf 1 2 3 4\nf 1 2 5 4\nf 1 2 6\n"));
    let scene = |keys: &str| {
        let object = format!("name = \"floor\"\n{keys}\nobj = \"m.obj\"\nscale = 2\ntranslate = [0, 0, 1]\n");
        let text = SCENE.replace("name = \"floor\"\nmaterial = \"grey\"\n", &object);
        let start = text.find("quads").expect("there");
        let end = text.find("[[cameras]]").expect("there");
        let text = [&text[..start], &text[end..]].concat();
        load(&folder.write("scene.toml", text))
    };
    for keys in ["material = \"grey\"", "materials = { Grey = \"grey\" }"] {
        let scene = scene(keys).expect("loads");
        assert_eq!(scene.geometry.objects, ["floor/top"]);
        assert_eq!(scene.geometry.surfaces.len(), 3, "a quad and the two triangles of the warped one");
        assert_eq!(scene.geometry.patch[1], scene.geometry.patch[2]);
        assert!((scene.geometry.surfaces[0].area - 4.0).abs() < 1e-6);
        assert_eq!(scene.notes.len(), 2, "warped, without area: {:?}", scene.notes);
    }
    let (line, column, message) = place(scene(""));
    assert_eq!((line, column), (9, 1));
    assert!(message.contains("did you mean \"grey\"") && message.contains("map it"), "{message}");
    folder.write("m.obj", format!("{square}f 1 2 3 99\n"));
    assert_eq!(place(scene("material = \"grey\"")).1, 9);
}
