//! A program of one's own with a law in Rust: this file is that program, and the test that runs it.

use std::fs;
use std::process::{Command, ExitCode, Output};

use gradreel::scalar::Mat3;
use gradreel_models::physics::{Given, Law, Material, Parameter, Point};

/// Kirchhoff stress `τ = G (F Fᵀ − J I) + K J (J − 1) I`.
#[derive(Debug)]
struct Gel(&'static str);

impl Material for Gel {
    fn name(&self) -> &str {
        self.0
    }
    fn parameters(&self) -> Vec<Parameter> {
        vec![Parameter::log10("shear", "G", "Pa", [1e3, 1e6]), Parameter::log10("bulk", "K", "Pa", [1e4, 1e7])]
    }
    fn stress(&self, point: &Point, given: &Given) -> Mat3 {
        let (j, b) = (point.f.det(), point.f * point.f.t());
        (b - Mat3::eye() * j) * given["shear"] + Mat3::eye() * (given["bulk"] * j * (j - 1.0))
    }
}

/// Set for the program, to the name of its law.
const NAME: &str = "NAME_OF_THE_LAW";

fn main() -> ExitCode {
    match std::env::var(NAME) {
        Ok(name) => gradreel_models::cli::run_with([Law::of(Gel(Box::leak(name.into_boxed_str())))]).into(),
        Err(_) => {
            test();
            ExitCode::SUCCESS
        }
    }
}

const SCENE: &str = "[time]\nduration_s = 0.1\n[grid]\nspacing_m = 0.05\n[ground]\n[materials.m]\nlaw = 'gel'\n\
                     density_kg_m3 = 1e3\nshear = 2e4\nbulk = 1e5\n[[objects]]\nmaterial = 'm'\n\
                     shape.sphere = { centre_m = [0, 0.12, 0], radius_m = 0.1 }\n\
                     [film]\ncameras = 3\npixels = [32, 32]\n";
const QUICK: &str = "[geometry]\ndx = 0.05\n[geometry.fit]\niterations = 4\nin_motion = 2\n[estimate]\nvelocity = 2\npoints = 1\n\
                     survivors = 1\nsteps = 1\n";

fn test() {
    let folder = tempfile::TempDir::new().unwrap();
    fs::write(folder.path().join("scene.toml"), SCENE).unwrap();
    fs::write(folder.path().join("quick.toml"), QUICK).unwrap();
    let run = |name: &str, arguments: &str| -> Output {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args(arguments.split_whitespace()).current_dir(folder.path()).env(NAME, name).output().unwrap()
    };
    let said = |output: &Output| String::from_utf8_lossy(&output.stderr).into_owned();
    let works = |arguments: &str| {
        let output = run("gel", arguments);
        assert_eq!(output.status.code(), Some(0), "{arguments}: {}", said(&output));
        String::from_utf8_lossy(&output.stdout).into_owned()
    };
    assert!(works("check-law gel --no-plot").contains("frame indifference"));
    works("simulate scene.toml --film --no-gif --out film -q");
    works("reconstruct film/clip --material gel --config quick.toml --out out -q");
    let found: serde_json::Value =
        serde_json::from_slice(&fs::read(folder.path().join("out/parameters.json")).unwrap()).unwrap();
    assert!(found["parameters"]["shear"]["value"].as_f64().unwrap() > 0.0, "{found}");
    // the run is of a law that another program does not have
    works("reconstruct film/clip --out out --resume -q");
    let other = run("jelly_of_others", "reconstruct film/clip --out out --resume -q");
    assert!(other.status.code() == Some(2) && said(&other).contains("gel"), "{}", said(&other));
    // shipped laws keep their names
    let taken = run("neo_hookean", "check-law neo_hookean --no-plot");
    assert!(taken.status.code() == Some(2) && said(&taken).contains("a law of this name exists"), "{}", said(&taken));
}
