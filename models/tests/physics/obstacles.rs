//! Bodies on obstacles: friction against the closed form, nothing passes, motion is handed on.

use gradreel_models::physics::{Collider, Contact, Law, Simulation, State, Values, World, materials};

use crate::scene::cube;

const DX: f64 = 0.04;

/// Runs particles of a material of density 1000 for some substeps; `look` sees every state.
fn run(
    world: &World,
    (name, values): (&str, &[f64]),
    x: &[[f64; 3]],
    v: [f64; 3],
    (dt, steps): (f64, usize),
    mut look: impl FnMut(&State<f64>),
) -> State<f64> {
    let law: Law = materials::find(name).unwrap();
    let parameters = values.iter().map(|&value| Values::Same(value)).collect();
    let mut simulation = Simulation::new(world, &law, dt, x.len(), &Values::Same(1000.0), parameters).unwrap();
    let mut now = simulation.at_rest(x, &vec![v; x.len()]).unwrap();
    let mut next = now.zeros_like();
    for _ in 0..steps {
        simulation.substep(&now, &mut next).unwrap();
        std::mem::swap(&mut now, &mut next);
        look(&now);
    }
    now
}

fn mean(vectors: &[[f64; 3]]) -> [f64; 3] {
    [0, 1, 2].map(|axis| vectors.iter().map(|v| v[axis]).sum::<f64>() / vectors.len() as f64)
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|axis| a[axis] * b[axis]).sum()
}

/// Directions down a slope and away from it.
fn slope(degrees: f64) -> [[f64; 3]; 2] {
    let (sin, cos) = degrees.to_radians().sin_cos();
    [[cos, -sin, 0.0], [sin, cos, 0.0]]
}

/// What stands on a floor, on a slope.
fn tilted(block: &[[f64; 3]], [down, normal]: [[f64; 3]; 2]) -> Vec<[f64; 3]> {
    let place = |x: &[f64; 3], i: usize| x[0] * down[i] + x[1] * normal[i] + if i == 2 { x[2] } else { 0.0 };
    block.iter().map(|x| std::array::from_fn(|i| place(x, i))).collect()
}

/// A block on a slope of 30°: its velocity \[m/s\] down the slope and away from it after a tenth of a second.
fn on_a_slope(contact: Contact, start: f64) -> [f64; 2] {
    let [down, normal] = slope(30.0);
    let block = tilted(&cube(6, DX, [0.0, 0.2 * DX, 0.0]), [down, normal]);
    let world = World { colliders: vec![Collider::plane([0.0; 3], normal, contact)], ..World::new(DX) };
    let end = run(&world, ("neo_hookean", &[1e5, 0.0]), &block, down.map(|d| start * d), (5e-4, 200), |_| ());
    let v = mean(&end.velocities());
    [dot(v, down), dot(v, normal)]
}

#[test]
fn a_block_slides_down_a_slope_as_coulomb_says() {
    let (sin, cos) = 30_f64.to_radians().sin_cos();
    let (g, time) = (9.8, 0.1);
    for mu in [0.0, 0.2, 0.5] {
        let [along, away] = on_a_slope(Contact::Friction(mu), 1.0);
        // What the slope pushed back is the weight, and what the block still bounces.
        let wanted = 1.0 + g * sin * time - mu * (g * cos * time + away);
        println!("µ = {mu}: {along:.5} m/s, {wanted:.5} wanted, bounce {away:.5}");
        approx::assert_relative_eq!(along, wanted, max_relative = 5e-3);
        assert!(away.abs() < 0.1, "the block lies on the slope");
    }
    let [frictionless, _] = on_a_slope(Contact::Separate, 1.0);
    approx::assert_relative_eq!(frictionless, 1.0 + g * sin * time, max_relative = 1e-9);
}

#[test]
fn a_block_on_a_slope_rougher_than_steep_stays() {
    // The slope lies along the grid and gravity is tilted: nodes then lie in the plane itself.
    let (sin, cos) = 30_f64.to_radians().sin_cos();
    let crept = |mu: f64| {
        let world = World {
            colliders: vec![Collider::plane([0.0; 3], [0.0, 1.0, 0.0], Contact::Friction(mu))],
            gravity: [9.8 * sin, -9.8 * cos, 0.0],
            ..World::new(DX)
        };
        let block = cube(6, DX, [0.0, 0.2 * DX, 0.0]);
        let mut places = Vec::new();
        run(&world, ("neo_hookean", &[1e5, 0.0]), &block, [0.0; 3], (5e-4, 600), |state| {
            places.push(mean(&state.positions())[0]);
        });
        // It settles into the grid first.
        places[599] - places[399]
    };
    let [rough, smooth] = [crept(0.8), crept(0.0)];
    println!("{rough:.5} m in a tenth of a second, {smooth:.5} m without friction");
    assert!(smooth > 0.12 && rough.abs() < 0.03 * smooth, "{rough} m, and {smooth} m without friction");
}

#[test]
fn a_slab_on_an_oblique_slope_stays_if_that_is_rough_enough() {
    // Stiff and flat: a tall, soft block rocks and hops down any slope.
    let slid = |degrees: f64| {
        let [down, normal] = slope(degrees);
        let slab: Vec<[f64; 3]> = cube(12, DX, [0.0, 0.2 * DX, 0.0]).into_iter().filter(|x| x[1] < 3.2 * DX).collect();
        let slab = tilted(&slab, [down, normal]);
        let world =
            World { colliders: vec![Collider::plane([0.0; 3], normal, Contact::Friction(0.8))], ..World::new(DX) };
        let mut places = Vec::new();
        run(&world, ("neo_hookean", &[1e6, 0.0]), &slab, [0.0; 3], (1e-4, 3000), |state| {
            places.push(dot(mean(&state.positions()), down));
        });
        places[2999] - places[999]
    };
    let [stays, slides] = [slid(30.0), slid(44.0)];
    // from the speed that it has after a tenth of a second
    let (sin, cos) = 44_f64.to_radians().sin_cos();
    let wanted = 0.5 * 9.8 * (sin - 0.8 * cos) * (0.3_f64.powi(2) - 0.1_f64.powi(2));
    println!("{stays:.6} m on 30°, {slides:.5} m on 44°, {wanted:.5} wanted");
    assert!(stays.abs() < 1e-4, "{stays} m in a fifth of a second");
    approx::assert_relative_eq!(slides, wanted, max_relative = 0.3);
}

#[test]
fn a_ball_lets_nothing_through_and_a_bowl_keeps_it_all() {
    let stream = cube(8, DX, [-0.16, 0.3, -0.16]);
    let (centre, radius) = ([0.02, 0.1, -0.01], 0.15);
    let distance = |x: [f64; 3]| (0..3).map(|a| (x[a] - centre[a]).powi(2)).sum::<f64>().sqrt();
    for contact in [Contact::Separate, Contact::Friction(0.3), Contact::Sticky] {
        let ball = Collider::sphere(centre, radius, contact);
        let bowl = Collider::sphere(centre, 0.5, contact).container();
        let world = World { colliders: vec![ball, bowl], ..World::new(DX) };
        let (mut deepest, mut widest) = (f64::INFINITY, 0.0_f64);
        let end = run(&world, ("newtonian", &[1.0, 2e4]), &stream, [0.0, -2.0, 0.0], (1e-3, 400), |state| {
            for x in state.positions() {
                deepest = deepest.min(distance(x));
                widest = widest.max(distance(x));
            }
        });
        println!("{contact:?}: closest {deepest:.4} m, farthest {widest:.4} m");
        assert!(deepest > radius - DX, "{contact:?}: a particle is {deepest} m from the centre");
        assert!(widest < 0.5 + DX, "{contact:?}: a particle is {widest} m from the centre");
        assert!(end.positions().iter().any(|x| x[1] < 0.1), "the fluid flows around the ball");
    }
}

#[test]
fn what_sticks_to_a_moving_wall_moves_with_it() {
    // Deep inside it, at once and exactly: a rigid motion is linear in space, and the transfer keeps linear fields.
    let (w, spin, pivot) = ([0.3, -0.1, 0.2], [0.5, 1.0, -2.0], [0.1, 0.0, 0.05]);
    let inside = cube(4, DX, [0.0; 3]);
    let block = Collider::cuboid([0.0; 3], [1.0; 3], Contact::Sticky).moving(w).spinning(spin, pivot);
    let world = World { colliders: vec![block], ..World::new(DX) };
    let end = run(&world, ("neo_hookean", &[1e5, 0.3]), &inside, [0.0; 3], (1e-4, 1), |_| ());
    for (v, x) in end.velocities().iter().zip(&inside) {
        let r: [f64; 3] = std::array::from_fn(|axis| x[axis] - pivot[axis]);
        let turning =
            [spin[1] * r[2] - spin[2] * r[1], spin[2] * r[0] - spin[0] * r[2], spin[0] * r[1] - spin[1] * r[0]];
        (0..3).for_each(|axis| approx::assert_abs_diff_eq!(v[axis], w[axis] + turning[axis], epsilon = 1e-12));
    }
    // Lying on it, soon: a stiff block trembles by some millimetres.
    let world = World { colliders: vec![Collider::ground(0.0).moving([0.5, 0.0, 0.0])], ..World::new(DX) };
    let block = cube(6, DX, [0.0, 0.2 * DX, 0.0]);
    let end = run(&world, ("neo_hookean", &[1e6, 0.3]), &block, [0.0; 3], (2e-4, 500), |_| ());
    let moved = mean(&end.positions())[0] - mean(&block)[0];
    assert!((moved - 0.05).abs() < 4e-3, "{moved} m in 0.1 s at 0.5 m/s");
}

#[test]
fn obstacles_that_make_no_sense_are_named() {
    let law = materials::find("neo_hookean").unwrap();
    let refused = |collider: Collider| {
        let world = World { colliders: vec![Collider::ground(0.0), collider], ..World::new(DX) };
        let parameters = vec![Values::Same(1e5), Values::Same(0.3)];
        Simulation::new(&world, &law, 1e-4, 1, &Values::Same(1000.0), parameters).unwrap_err().to_string()
    };
    let flat = refused(Collider::cuboid([0.0; 3], [1.0, 0.0, 1.0], Contact::Slip));
    assert!(flat.contains("World::colliders[1]") && flat.contains("no size"), "{flat}");
    let rough = refused(Collider::plane([0.0; 3], [0.0, 1.0, 0.0], Contact::Friction(-0.1)));
    assert!(rough.contains("friction") && rough.contains("-0.1"), "{rough}");
    let lost = refused(Collider::sphere([0.0; 3], 1.0, Contact::Slip).moving([f64::NAN, 0.0, 0.0]));
    assert!(lost.contains("no place or motion"), "{lost}");
}
