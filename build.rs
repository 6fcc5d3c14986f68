//! Builds the C interface to Embree when the feature `embree` asks for it; nothing to do otherwise.

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    #[cfg(feature = "embree")]
    if let Err(sentence) = embree::build() {
        eprintln!("{sentence}");
        std::process::exit(1);
    }
}

#[cfg(feature = "embree")]
mod embree {
    use std::env;
    use std::path::{Path, PathBuf};

    const INSTALL: &str = "install it (Debian and Ubuntu: apt install libembree-dev libclang-dev) \
                           or set EMBREE_DIR to a folder with include/ and lib/";

    /// An Embree that was found.
    struct Installation {
        include: PathBuf,
        lib: PathBuf,
        major: u32,
    }

    pub fn build() -> Result<(), String> {
        for file in ["ffi/embree.h", "ffi/embree.c"] {
            println!("cargo:rerun-if-changed={file}");
        }
        let chosen = env_var("EMBREE_DIR").filter(|dir| !dir.is_empty());
        let embree = match &chosen {
            Some(dir) => find_under(Path::new(dir))
                .ok_or_else(|| format!("EMBREE_DIR={dir} holds no {} with its headers", wanted()))?,
            None => find_in_usual_places()
                .ok_or_else(|| format!("feature `embree` needs {}: {INSTALL}", wanted()))?,
        };
        check_version(&embree)?;
        compile(&embree)?;
        bind()?;
        link(&embree, chosen.is_some());
        Ok(())
    }

    fn env_var(name: &str) -> Option<String> {
        println!("cargo:rerun-if-env-changed={name}");
        env::var(name).ok()
    }

    /// Both versions export the same symbols: next to embree4-sys only Embree 4 will do.
    fn majors() -> &'static [u32] {
        if cfg!(feature = "embree4-sys") { &[4] } else { &[4, 3] }
    }

    fn wanted() -> &'static str {
        if cfg!(feature = "embree4-sys") { "Embree 4" } else { "Embree 3.13 or 4" }
    }

    fn find_in_usual_places() -> Option<Installation> {
        ["/usr/local", "/usr", "/opt/homebrew"].iter().find_map(|dir| find_under(Path::new(dir)))
    }

    fn find_under(root: &Path) -> Option<Installation> {
        let root = root.canonicalize().ok()?;
        let multiarch = format!("lib/{}-linux-gnu", env::var("CARGO_CFG_TARGET_ARCH").unwrap_or_default());
        majors().iter().find_map(|&major| {
            let include = root.join("include");
            include.join(format!("embree{major}/rtcore.h")).is_file().then_some(())?;
            let names = [format!("libembree{major}.so"), format!("libembree{major}.dylib")];
            let lib = ["lib", multiarch.as_str(), "lib64"]
                .iter()
                .map(|folder| root.join(folder))
                .find(|lib| names.iter().any(|name| lib.join(name).exists()))?;
            Some(Installation { include, lib, major })
        })
    }

    /// The headers must be 3.13 or later: earlier ones lack nothing we call but were never tried.
    fn check_version(embree: &Installation) -> Result<(), String> {
        let path = embree.include.join(format!("embree{}/rtcore_config.h", embree.major));
        println!("cargo:rerun-if-changed={}", path.display());
        let text = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        let number = |name: &str| {
            let line = text.lines().find_map(|l| l.trim().strip_prefix("#define ")?.strip_prefix(name))?;
            line.trim().parse::<u32>().ok()
        };
        match (number("RTC_VERSION_MAJOR"), number("RTC_VERSION_MINOR")) {
            (Some(major), Some(minor)) if (major, minor) >= (3, 13) && major <= 4 => Ok(()),
            (Some(major), Some(minor)) => Err(format!(
                "feature `embree` needs {}, but {} is of {major}.{minor}",
                wanted(),
                path.display()
            )),
            _ => Err(format!("{} does not state a version of Embree: {INSTALL}", path.display())),
        }
    }

    fn compile(embree: &Installation) -> Result<(), String> {
        cc::Build::new()
            .file("ffi/embree.c")
            .include(&embree.include)
            .define("LUXGRAPH_EMBREE_MAJOR", embree.major.to_string().as_str())
            .std("c11")
            .opt_level(2)
            .extra_warnings(true)
            .try_compile("luxgraph_embree")
            .map_err(|e| {
                format!("ffi/embree.c could not be compiled (Debian and Ubuntu: apt install gcc): {e}")
            })
    }

    /// Turns ffi/embree.h into Rust. Without libclang bindgen panics with a page of text, so the panic is caught
    /// and one sentence takes its place.
    fn bind() -> Result<(), String> {
        let hook = std::panic::take_hook();
        std::panic::set_hook(Box::new(|_| {}));
        let bindings = std::panic::catch_unwind(|| {
            bindgen::Builder::default()
                .header("ffi/embree.h")
                .allowlist_item("(lux|LUX)_.*")
                .prepend_enum_name(false)
                .generate()
        });
        std::panic::set_hook(hook);
        let missing = "feature `embree` needs libclang to read ffi/embree.h: install it \
                       (Debian and Ubuntu: apt install libclang-dev) or set LIBCLANG_PATH";
        let bindings = match bindings {
            Ok(Ok(bindings)) => bindings,
            Ok(Err(e)) => return Err(format!("{missing}: {e}")),
            Err(_) => return Err(missing.into()),
        };
        let out = PathBuf::from(env::var("OUT_DIR").map_err(|e| e.to_string())?).join("embree.rs");
        bindings.write_to_file(&out).map_err(|e| format!("{}: {e}", out.display()))
    }

    /// A library outside the system's folders is also found when the program runs.
    fn link(embree: &Installation, chosen: bool) {
        println!("cargo:rustc-link-search=native={}", embree.lib.display());
        println!("cargo:rustc-link-lib=dylib=embree{}", embree.major);
        if chosen {
            println!("cargo:rustc-link-arg=-Wl,-rpath,{}", embree.lib.display());
        }
    }
}
