//! Scenes that are drawn: something elastic falls onto a floor.

use std::collections::BTreeMap;

use gradreel::Key;

use crate::physics::CFL;
use crate::scenes::{
    Camera, FilmSettings, Grid, Ground, Object, Precision, SceneFile, Shape, Substance, Surroundings, Time, Touch,
};
use crate::video::parabola::GRAVITY;
use crate::views::objects::Dice;

/// Cells of the grid in a body's size.
const CELLS: f64 = 9.0;
/// Longer side of a picture \[pixels\].
const LONGER: usize = 320;
/// Share of the picture's height that fall and object take.
const FILLED: [f64; 2] = [0.45, 0.75];

/// A scene with a single camera, drawn from a key.
pub(crate) fn scene(key: Key) -> SceneFile {
    let mut dice = Dice::new(key);
    let size = 0.05 * 6f64.powf(dice.within(0.0, 1.0));
    let drop = dice.within(0.25, 1.1);
    let rate = [25.0, 30.0, 30.0, 60.0][dice.below(4)];
    let height = drop + 0.5 * size;
    let centre_m = [0.0, height, 0.0];
    let radius = 0.5 * size;
    let shape = match dice.below(10) {
        0..4 => Shape::Sphere { centre_m, radius_m: radius },
        4 | 5 => Shape::Box { centre_m, size_m: dice.three(0.6, 1.0).map(|x| x * size) },
        6 => Shape::Cone { centre_m, radius_m: radius, height_m: size },
        7 | 8 => Shape::Cylinder { centre_m, radius_m: dice.within(0.6, 1.0) * radius, height_m: size },
        _ => Shape::Torus { centre_m, ring_radius_m: 0.66 * radius, tube_radius_m: 0.34 * radius },
    };
    let turn = dice.within(0.0, 180.0);
    let turn_deg = dice.direction().map(|x| turn * x);
    let colour = dice.three(0.1, 0.95).map(|x| (255.0 * x) as u8);
    let velocity_m_s = [dice.within(-0.5, 0.5), dice.within(-0.5, 0.3), dice.within(-0.3, 0.3)];
    let object = Object {
        material: "body".to_owned(),
        shape,
        turn_deg,
        velocity_m_s,
        spin_rad_s: [0.0; 3],
        colour: Some(format!("#{:02x}{:02x}{:02x}", colour[0], colour[1], colour[2])),
    };
    let stiff = 10f64.powf(dice.within(4.7, 6.0));
    let parameters = BTreeMap::from([("young".to_owned(), stiff), ("poisson".to_owned(), dice.within(0.25, 0.45))]);
    let density_kg_m3 = 10f64.powf(dice.within(2.0, 3.1));
    let pixels = match dice.below(3) {
        0 => [LONGER, LONGER * 3 / 4],
        1 => [LONGER, LONGER * 9 / 16],
        _ => [LONGER * 9 / 16, LONGER],
    };
    let field_of_view_deg = dice.within(35.0, 65.0);
    let filled = dice.within(FILLED[0], FILLED[1]);
    let distance = (drop + size) / filled * 0.5 / (0.5 * field_of_view_deg.to_radians()).tan();
    let film = FilmSettings {
        cameras: 1,
        pixels,
        field_of_view_deg,
        elevation_deg: vec![dice.within(-5.0, 35.0)],
        target_m: Some([dice.within(-0.1, 0.1) * drop, 0.5 * (drop + size), 0.0]),
        distance_m: Some(distance),
        pattern: dice.within(0.2, 0.8),
    };
    SceneFile {
        title: format!("{size:.3} m across, from {drop:.2} m"),
        time: Time {
            duration_s: (2.0 * drop / GRAVITY).sqrt() + dice.within(0.4, 0.7),
            frames_per_s: rate,
            substeps_per_frame: None,
            cfl: CFL,
        },
        grid: Grid {
            spacing_m: size / CELLS,
            particles_per_cell: 8,
            flip: 0.0,
            precision: Precision::F32,
            seed: 0,
            node_limit: 1 << 24,
        },
        world: Surroundings::default(),
        ground: Some(Ground { height_m: 0.0, contact: Touch::Friction, friction: Some(dice.within(0.3, 0.9)) }),
        colliders: vec![],
        materials: BTreeMap::from([(
            "body".to_owned(),
            Substance { law: "neo_hookean".to_owned(), density_kg_m3, parameters },
        )]),
        objects: vec![object],
        camera: Camera::default(),
        film: Some(film),
    }
}
