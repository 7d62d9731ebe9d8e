//! Obstacles thinner than the grid, wherever they lie between its nodes: nothing passes them.

use std::path::Path;

use gradreel_models::scenes::{Runner, SceneFile, Setup};

/// Ball of 0.1 m that flies along x at this speed \[m/s\] towards an obstacle.
fn scene(speed: f64, law: &str, collider: &str) -> Setup {
    let text = format!(
        "[time]\nduration_s = {}\nframes_per_s = {}\n[grid]\nspacing_m = 0.04\n[world]\ngravity_m_s2 = [0, 0, 0]\n\
         [materials.a]\ndensity_kg_m3 = 1000\n{law}\n\
         [[objects]]\nmaterial = \"a\"\nvelocity_m_s = [{speed}, 0, 0]\n\
         shape.sphere = {{ centre_m = [-0.3, 1, 0], radius_m = 0.1 }}\n\
         [[colliders]]\n{collider}\n",
        0.75 / speed,
        10.0 * speed / 0.75
    );
    Setup::of(&SceneFile::parse(&text).unwrap(), Path::new(".")).unwrap()
}

const RUBBER: &str = "law = \"neo_hookean\"\nyoung = 2e5\npoisson = 0.3";
const STIFF: &str = "law = \"stvk_hencky\"\nyoung = 2e6\npoisson = 0.3";
const WATER: &str = "law = \"newtonian\"\nviscosity = 1\nbulk = 2e5";
const CONTACTS: [&str; 4] =
    ["contact = \"sticky\"", "contact = \"slip\"", "contact = \"separate\"", "contact = \"friction\"\nfriction = 0.4"];

/// Looks at the positions of every frame; returns the mean velocity along x at the end.
fn run(setup: &Setup, mut look: impl FnMut(usize, &[[f32; 3]])) -> f64 {
    let mut runner = Runner::<f32>::new(setup).unwrap();
    while runner.frame().index + 1 < setup.schedule.frames {
        assert!(runner.advance(|| true).unwrap());
        let frame = runner.frame();
        look(frame.index, &frame.positions);
    }
    let totals = runner.frame().totals;
    totals.momentum_kg_m_s[0] / totals.mass_kg
}

#[test]
fn a_ball_bounces_off_a_plate_wherever_that_lies_on_the_grid() {
    for contact in CONTACTS {
        for at in [0.0, 0.01, 0.02, 0.033] {
            let plate = format!("{contact}\nshape.box = {{ centre_m = [{at}, 1, 0], size_m = [0.02, 1, 1] }}");
            let setup = scene(5.0, RUBBER, &plate);
            let thick = format!("{contact}\nshape.box = {{ centre_m = [{}, 1, 0], size_m = [0.5, 1, 1] }}", at + 0.24);
            let thick = run(&scene(5.0, RUBBER, &thick), |_, _| ());
            assert!(setup.notes.iter().any(|note| note.starts_with("colliders[0]")), "{:?}", setup.notes);
            let face = at as f32 - 0.01;
            let back = run(&setup, |frame, positions| {
                let passed = positions.iter().filter(|x| x[0] > face + 1e-5).count();
                assert_eq!(passed, 0, "{contact}, plate at {at} m, frame {frame}");
            });
            assert!(back < 0.8 * thick, "{contact}, plate at {at} m: {back} m/s, and {thick} m/s from a thick wall");
        }
    }
}

#[test]
fn nothing_tunnels_through_a_thin_plate_at_40_m_s() {
    for (law, contact) in [(STIFF, CONTACTS[2]), (WATER, CONTACTS[3]), (WATER, CONTACTS[0])] {
        for (at, thick) in [(0.0, 0.02), (0.02, 0.001)] {
            let plate = format!("{contact}\nshape.box = {{ centre_m = [{at}, 1, 0], size_m = [{thick}, 4, 4] }}");
            let face = (at - 0.5 * thick) as f32;
            run(&scene(40.0, law, &plate), |frame, positions| {
                let passed = positions.iter().filter(|x| x[0] > face + 1e-5).count();
                assert_eq!(passed, 0, "{law}, {contact}, plate at {at} m, {thick} m thick, frame {frame}");
            });
        }
    }
}

#[test]
fn no_particle_is_inside_a_ball_or_a_rod_smaller_than_a_cell() {
    for at in [0.0, 0.02] {
        for contact in [CONTACTS[0], CONTACTS[2]] {
            let ball = format!("{contact}\nshape.sphere = {{ centre_m = [{at}, 1.01, 0.01], radius_m = 0.015 }}");
            let mut near = f32::INFINITY;
            run(&scene(10.0, WATER, &ball), |_, positions| {
                for x in positions {
                    let r = ((x[0] - at as f32).powi(2) + (x[1] - 1.01).powi(2) + (x[2] - 0.01).powi(2)).sqrt();
                    near = near.min(r);
                }
            });
            assert!(near > 0.015 - 1e-5 && near < 0.03, "{contact}, ball at {at} m: {near} m from its centre");
            let rod = format!(
                "{contact}\nshape.cylinder = {{ start_m = [{at}, 0.5, 0], end_m = [{at}, 1.5, 0], radius_m = 0.01 }}"
            );
            let mut near = f32::INFINITY;
            run(&scene(10.0, WATER, &rod), |_, positions| {
                positions.iter().for_each(|x| near = near.min((x[0] - at as f32).hypot(x[2])));
            });
            assert!(near > 0.01 - 1e-5 && near < 0.03, "{contact}, rod at {at} m: {near} m from its axis");
        }
    }
}

#[test]
fn a_thin_plate_that_moves_or_is_tilted_hits_a_body_as_one_at_rest_does() {
    // At 45° to the way of the ball, 5 m/s along x become 5 m/s upwards, less what the ball keeps of the impact.
    let tilted =
        "contact = \"separate\"\nturn_deg = [0, 0, -45]\nshape.box = { centre_m = [0, 1, 0], size_m = [0.01, 2, 2] }";
    run(&scene(5.0, RUBBER, tilted), |frame, positions| {
        let depth = positions.iter().map(|x| (x[0] - (x[1] - 1.0)) / 2.0_f32.sqrt()).fold(f32::NEG_INFINITY, f32::max);
        assert!(depth < -0.005 + 1e-4, "frame {frame}: {depth} m beyond the middle of the plate");
    });
    // the plate comes at 40 m/s
    let coming = "contact = \"separate\"\nvelocity_m_s = [-40, 0, 0]\nshape.box = { centre_m = [0.1, 1, 0], size_m = [0.01, 3, 3] }";
    let setup = scene(1.0, WATER, coming);
    let setup = Setup { schedule: gradreel_models::physics::Schedule { frames: 3, ..setup.schedule }, ..setup };
    let dt = setup.schedule.frame_dt;
    let substep = setup.schedule.dt();
    let end = run(&setup, |frame, positions| {
        // where the plate was one substep before, which is what the particles have met
        let face = (0.1 - 0.005 - 40.0 * (dt * frame as f64 - substep)) as f32;
        let behind = positions.iter().filter(|x| x[0] > face + 1e-4).count();
        assert_eq!(behind, 0, "frame {frame}: particles behind the plate");
    });
    assert!(end < -39.0, "{end} m/s: it carries the water along");
}
