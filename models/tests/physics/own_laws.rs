//! Laws in WGSL that are not shipped: checks, and that the checks see faults.

use gradreel::{Tensor, gradcheck};
use gradreel_models::physics::{
    Body, Collider, Law, Remat, Rollout, Schedule, State, WgslLaw, World, check_material, materials, responses, rollout,
};

/// The laws of `examples/laws`.
const EXAMPLES: [&str; 4] = ["ogden", "maxwell", "fibres", "layers"];

fn example(name: &str) -> Law {
    Law::read(format!("../examples/laws/{name}.wgsl")).unwrap()
}

#[test]
fn the_examples_pass_every_check() {
    for name in EXAMPLES {
        let law = example(name);
        assert!(law.text().unwrap().lines().count() <= 40, "{name}");
        let report = check_material(&law).unwrap();
        assert!(report.passed(), "{report}");
        assert_eq!(law.is_elastic(), name != "maxwell", "{name}");
    }
}

/// A law with one parameter `a`, 1e5 Pa, and this stress.
fn law(stress: &str) -> Law {
    let text = format!(
        "struct Parameters {{
            /// Modulus a [Pa], log10, 1e4 to 1e6
            a: f32,
        }}
        fn stress(point: Point, p: Parameters) -> mat3x3<f32> {{ return {stress}; }}"
    );
    Law::of(WgslLaw::parse("wrong.wgsl", &text).unwrap())
}

#[test]
fn every_fault_of_a_law_is_seen() {
    let cases = [
        // the stretch of axes that do not turn with the body
        ("p.a * (sym(point.f) - identity())", "frame indifference"),
        (
            "p.a * (point.f * transpose(point.f) - identity()) + p.a * (point.f - transpose(point.f)) * point.f",
            "symmetry of the stress",
        ),
        ("p.a * (point.f * transpose(point.f))", "no stress at rest"),
        // a bulk stress that depends on shear has no energy
        ("p.a * (ddot(point.f, point.f) - 3.0) * identity()", "energy in a closed cycle"),
    ];
    for (stress, name) in cases {
        let report = check_material(&law(stress)).unwrap();
        let check = report.checks.iter().find(|check| check.name == name).unwrap();
        assert!(!check.passed(), "{stress}: {report}");
    }
    let slow = "struct Parameters {
            /// Modulus a [Pa], log10, 1e4 to 1e6
            a: f32,
        }
        fn stress(point: Point, p: Parameters) -> mat3x3<f32> { return p.a * (point.f * transpose(point.f) - identity()); }
        fn wave_speed(p: Parameters, density: f32) -> f32 { return sqrt(p.a / density); }";
    let report = check_material(&Law::of(WgslLaw::parse("slow.wgsl", slow).unwrap())).unwrap();
    let check = report.checks.iter().find(|check| check.name == "wave speed").unwrap();
    // P-waves of τ = a (F Fᵀ − I) travel at √(2a/ρ)
    approx::assert_relative_eq!(check.found, 2.0_f64.sqrt() - 1.0, max_relative = 1e-9);
}

#[test]
fn responses_are_those_of_the_formula() {
    let law = materials::find("neo_hookean").unwrap();
    let [uniaxial, shear, volumetric] = responses(&law, &[2.6, 0.3]);
    // μ = 1, λ = 1.5
    for &(strain, stress) in &uniaxial.points {
        let s: f64 = 1.0 + strain;
        approx::assert_relative_eq!(stress, s * s + 1.5 * s.ln() - 1.0, epsilon = 1e-9);
    }
    for &(strain, stress) in &shear.points {
        approx::assert_relative_eq!(stress, strain, epsilon = 1e-9);
    }
    for &(strain, stress) in &volumetric.points {
        let s: f64 = 1.0 + strain;
        approx::assert_relative_eq!(stress, s * s + 4.5 * s.ln() - 1.0, epsilon = 1e-9);
    }
    assert_eq!(uniaxial.points.len(), 240);
}

#[test]
fn a_law_of_one_s_own_is_found_by_its_name() {
    let text = include_str!("../../laws/neo_hookean.wgsl");
    materials::register(Law::of(WgslLaw::parse("registered_rubber.wgsl", text).unwrap())).unwrap();
    assert_eq!(materials::find("registered_rubber").unwrap().text(), Some(text));
    for taken in ["registered_rubber", "neo_hookean", "sand", "auto"] {
        let law = WgslLaw::parse(&format!("{taken}.wgsl"), text).unwrap();
        // `auto` never becomes a name
        assert_eq!(materials::register(Law::of(law)).is_err(), taken != "auto", "{taken}");
    }
}

/// A block of a law whose layers and fibres belong to the particles: derivatives in places, velocity, density and parameters.
#[test]
fn what_varies_in_space_is_differentiated_through() {
    let block: Vec<f64> = (0..3 * 64)
        .map(|i| [i / 3 / 16, i / 12 % 4, i / 3 % 4][i % 3] as f64 * 0.02 + [0.013, 0.021, -0.03][i % 3])
        .collect();
    let middle: Vec<f64> = (0..3).map(|axis| block.iter().skip(axis).step_by(3).sum::<f64>() / 64.0).collect();
    let places: Vec<[f64; 3]> =
        block.as_chunks::<3>().0.iter().map(|x| std::array::from_fn(|axis| x[axis] - middle[axis])).collect();
    let law = example("layers").placed(&places);
    let world = World { colliders: vec![Collider::ground(0.0)], ..World::new(0.04) };
    let schedule = Schedule { frames: 3, frame_dt: 0.02, substeps: 40 };
    let number = |value: f64| Tensor::from_vec(vec![value], [1]);
    let inputs = [
        ("positions", Tensor::from_vec(block, [64, 3])),
        ("velocity", Tensor::from_vec(vec![0.3, -2.0, 0.1], [3])),
        ("density", number(1000.0)),
        ("lower", number(2e4)),
        ("upper", number(8e4)),
        ("bulk", number(1e5)),
        ("fibres", number(5e4)),
    ];
    let motion = |body: Body| rollout(&world, &law, schedule, Remat::default(), &body);
    let report = gradcheck("layers", &inputs, |_, x| {
        let [positions, velocity, density, ..] = [0, 1, 2].map(|k| x[k].clone());
        let moved = motion(Body { positions, velocity, density, parameters: x[3..].to_vec() })?;
        Ok((&moved.select(0, 2) - &x[0]).square().sum_all())
    });
    let report = report.unwrap();
    println!("{report}");
    // forward mode, along each parameter, moves particles of both layers
    let rollout = Rollout::of_one(&world, &law, schedule);
    let tensors: Vec<Tensor> = inputs.iter().map(|(_, tensor)| tensor.clone()).collect();
    let along = |k: usize| (0..7).map(|j| (j == k).then(|| number(1e4))).collect::<Vec<_>>();
    let (_, changes) = rollout.jvp(&tensors, &[3, 4, 6].map(along)).unwrap();
    assert!(changes.iter().all(|change| change.to_vec().unwrap().iter().any(|x| x.abs() > 1e-5)));
}

/// Without places the particles of a rollout start from where they are, around their mean.
#[test]
fn a_law_is_placed_by_its_particles() {
    use gradreel_models::physics::{Simulation, Values};
    let (world, law) = (World::new(0.04), example("layers"));
    let parameters = || vec![Values::Same(2e4), Values::Same(8e4), Values::Same(1e5), Values::Same(5e4)];
    let start = |law: &Law, x: &[[f64; 3]]| -> State<f64> {
        let simulation = Simulation::new(&world, law, 1e-4, x.len(), &Values::Same(1000.0), parameters()).unwrap();
        simulation.at_rest(x, &vec![[0.0; 3]; x.len()]).unwrap()
    };
    let x = [[1.0, 5.0, 0.0], [1.0, 5.1, 0.0], [1.1, 5.3, 0.0]];
    assert_eq!(start(&law, &x).history(0), [0.0, 0.0, 1.0]);
    let turned = law.placed(&[[0.0, 0.1, 0.0], [0.0, -0.1, 0.0], [0.0, -0.1, 0.0]]);
    assert_eq!(start(&turned, &x).history(0), [1.0, 0.0, 0.0]);
}
