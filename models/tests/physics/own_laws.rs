//! Laws in WGSL that are not shipped: checks, and that the checks see faults.

use gradreel_models::physics::{Law, WgslLaw, check_material, materials, responses};

/// The laws of `examples/laws`.
const EXAMPLES: [&str; 3] = ["ogden", "maxwell", "fibres"];

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
