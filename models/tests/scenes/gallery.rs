//! Every scene of the gallery is sound, and runs.

use std::path::{Path, PathBuf};

use gradreel_models::scenes::{Runner, SceneFile, Setup};

fn gallery() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/scenes");
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut files: Vec<PathBuf> = files.filter(|path| path.extension().is_some_and(|e| e == "toml")).collect();
    files.sort();
    files
}

#[test]
fn every_scene_starts_and_keeps_its_mass() {
    let scenes = gallery();
    assert!(scenes.len() >= 6, "{scenes:?}");
    for path in scenes {
        let mut file = SceneFile::read(&path).unwrap();
        // A few substeps only.
        file.time.duration_s = 2e-3;
        file.time.frames_per_s = 1e3;
        let setup = Setup::of(&file, path.parent().unwrap()).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        assert!((500..30_000).contains(&setup.len()), "{}: {} particles", path.display(), setup.len());
        let mut runner = Runner::<f32>::new(&setup).unwrap();
        let start = runner.frame();
        while runner.frame().index + 1 < setup.schedule.frames {
            assert!(runner.advance(|| true).unwrap());
        }
        let end = runner.frame();
        assert_eq!(end.index, 2, "{}", path.display());
        approx::assert_relative_eq!(end.totals.mass_kg, start.totals.mass_kg, max_relative = 1e-12);
        assert_ne!(start.positions, end.positions);
        println!("{}: {} particles, {} substeps", path.display(), setup.len(), setup.schedule.substeps);
    }
}

#[test]
fn a_run_goes_on_where_it_stopped() {
    let path = gallery().into_iter().find(|path| path.ends_with("snow.toml")).unwrap();
    let mut file = SceneFile::read(&path).unwrap();
    file.time.duration_s = 3e-3;
    file.time.frames_per_s = 1e3;
    file.grid.spacing_m = 0.05;
    let setup = Setup::of(&file, path.parent().unwrap()).unwrap();
    let mut whole = Runner::<f32>::new(&setup).unwrap();
    whole.advance(|| true).unwrap();
    let snapshot = whole.snapshot();
    // Stopped within a frame, nothing has changed.
    let mut substeps = 0;
    let stopped = whole.advance(|| {
        substeps += 1;
        substeps < 2
    });
    assert!(!stopped.unwrap());
    assert_eq!(whole.snapshot().state, snapshot.state);
    whole.advance(|| true).unwrap();
    let mut later = Runner::<f32>::resume(&setup, &snapshot).unwrap();
    later.advance(|| true).unwrap();
    assert_eq!(later.frame().index, 2);
    assert_eq!(later.frame().positions, whole.frame().positions);
    let mut damaged = snapshot;
    damaged.state.pop();
    assert!(Runner::<f32>::resume(&setup, &damaged).unwrap_err().to_string().contains("does not belong"));
}

#[test]
fn a_spinning_body_starts_with_the_angular_momentum_of_a_rigid_one() {
    let file = SceneFile::parse(
        r#"
        [time]
        duration_s = 0.01
        frames_per_s = 100
        [grid]
        spacing_m = 0.02
        precision = "f64"
        [world]
        gravity_m_s2 = [0, 0, 0]
        [materials.m]
        law = "neo_hookean"
        density_kg_m3 = 1000
        young = 1e6
        poisson = 0.3
        [[objects]]
        material = "m"
        shape.sphere = { centre_m = [0, 0, 0], radius_m = 0.1 }
        spin_rad_s = [0, 0, 3]
        "#,
    )
    .unwrap();
    let setup = Setup::of(&file, Path::new(".")).unwrap();
    let mut runner = Runner::<f64>::new(&setup).unwrap();
    let start = runner.frame().totals;
    // I = 2/5 m r², and each particle turns by itself with m dx²/4 about two axes.
    let wanted = start.mass_kg * (0.4 * 0.01 + 0.5 * 0.02 * 0.02) * 3.0;
    approx::assert_relative_eq!(start.angular_momentum_kg_m2_s[2], wanted, max_relative = 0.02);
    runner.advance(|| true).unwrap();
    let end = runner.frame().totals;
    approx::assert_relative_eq!(
        end.angular_momentum_kg_m2_s[2],
        start.angular_momentum_kg_m2_s[2],
        max_relative = 1e-9
    );
    assert!(end.momentum_kg_m_s.iter().all(|p| p.abs() < 1e-9 * start.mass_kg));
}
