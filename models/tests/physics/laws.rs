//! Every shipped material through the battery of checks, and a spoilt one that must not get through.

use gradreel::scalar::{Mat3, Scalar};
use gradreel_models::physics::{Given, History, Law, Material, Parameter, Point, check_material, materials};

#[test]
fn every_shipped_material_passes_the_battery() {
    for law in materials::all() {
        let report = check_material(&law).unwrap();
        println!("{report}");
        assert!(report.passed(), "{report}");
        let skipped: Vec<_> = report.checks.iter().filter(|check| check.is_skipped()).map(|check| check.name).collect();
        assert!(skipped.iter().all(|name| {
            ["gradient on both sides of yield", "energy in a closed cycle", "CPU and WGSL"].contains(name)
        }));
    }
}

/// A law with one fault at a time.
#[derive(Debug)]
struct Spoilt {
    prestressed: bool,
    aligned: bool,
    times: Option<&'static str>,
}

impl Material for Spoilt {
    fn name(&self) -> &str {
        "spoilt"
    }

    fn parameters(&self) -> Vec<Parameter> {
        let bulk = Parameter::log10("bulk", "K", "Pa", [1e4, 1e6]);
        vec![self.times.map_or(bulk, |other| bulk.usually_times(other, 10.0, 0.5))]
    }

    fn stress(&self, point: &Point, given: &Given) -> Mat3 {
        let mut strain = Mat3::eye() * (point.f.det() - if self.prestressed { 0.99 } else { 1.0 });
        if self.aligned {
            strain.0[0][0] *= 2.0;
        }
        strain * given["bulk"]
    }
}

#[test]
fn a_spoilt_material_is_caught() {
    let failed = |prestressed: bool, aligned: bool| -> Vec<&'static str> {
        let report = check_material(&Law::of(Spoilt { prestressed, aligned, times: None })).unwrap();
        report.checks.iter().filter(|check| !check.passed()).map(|check| check.name).collect()
    };
    assert_eq!(failed(false, false), Vec::<&str>::new());
    assert_eq!(failed(true, false), ["no stress at rest"]);
    // a stress that does not turn with the body derives from no energy either
    assert_eq!(failed(false, true), ["frame indifference", "energy in a closed cycle"]);
}

#[test]
fn the_default_wave_speed_is_that_of_pressure_waves() {
    let law = Law::of(Spoilt { prestressed: false, aligned: false, times: None });
    approx::assert_relative_eq!(law.wave_speed(&[4e5], 1000.0), 20.0, max_relative = 1e-12);
}

/// Fibres along y in a soft matrix, which stiffen with every compression that the body has gone through.
#[derive(Debug)]
struct Fibres {
    /// How many times as stiff the fibres are after a logarithmic compression of one.
    stiffening: f64,
}

impl Material for Fibres {
    fn name(&self) -> &str {
        "fibres"
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![Parameter::log10("modulus", "E", "Pa", [1e3, 1e6])]
    }

    fn history(&self) -> Vec<History> {
        vec![History { name: "pressed", unit: "-", start: 0.0 }]
    }

    fn evolve(&self, point: &Point, given: &Given) -> Vec<Scalar> {
        vec![given["pressed"].max(1.0 - point.f.det())]
    }

    fn stress(&self, point: &Point, given: &Given) -> Mat3 {
        let e = point.f.sym() - Mat3::eye();
        let mut tau = e * given["modulus"];
        tau.0[1][1] += given["modulus"] * 15.0 * (1.0 + given["pressed"] * self.stiffening) * e.0[1][1];
        tau
    }
}

#[test]
fn the_default_wave_speed_bounds_every_direction() {
    // Along the fibres sixteen times the modulus, across them once.
    let speed = Law::of(Fibres { stiffening: 0.0 }).wave_speed(&[1e5], 1000.0);
    let at_rest = (16.0_f64 * 1e5 / 1000.0).sqrt();
    assert!(speed >= at_rest && speed < 1.4 * at_rest, "{speed} m/s, {at_rest} m/s at rest");
    // Of a law that resists shear alone: the fastest wave runs along the diagonal of the axes, `a = n = (1, 1, 1)/√3`, where
    // `a·τ(a⊗n) n = 2/3 G`; along an axis it is half of G.
    #[derive(Debug)]
    struct Stiff;
    impl Material for Stiff {
        fn name(&self) -> &str {
            "stiff"
        }
        fn parameters(&self) -> Vec<Parameter> {
            vec![Parameter::log10("shear", "G", "Pa", [1e3, 1e6])]
        }
        fn stress(&self, point: &Point, given: &Given) -> Mat3 {
            let mut tau = (point.f.sym() - Mat3::eye()) * given["shear"];
            (0..3).for_each(|i| tau.0[i][i] = 0.0.into());
            tau
        }
    }
    let found = Law::of(Stiff).wave_speed(&[4e5], 1000.0);
    assert!(found >= 0.999 * (2.0 / 3.0 * 4e5_f64 / 1000.0).sqrt(), "{found} m/s");
}

#[test]
fn the_default_wave_speed_bounds_what_the_history_stiffens() {
    let of = |stiffening: f64| Law::of(Fibres { stiffening }).wave_speed(&[1e5], 1000.0);
    // pressed to 80 % of its volume, the fibres are as stiff as 15 (1 + 0.2 · 20) and the matrix as 1
    let stiffened = (1e5 * (15.0 * 5.0 + 1.0) * 0.93 / 1000.0_f64).sqrt();
    assert!(of(20.0) > stiffened, "{} m/s, at least {stiffened} m/s", of(20.0));
    assert!(of(20.0) < 2.0 * stiffened && of(0.0) < stiffened);
}

#[test]
#[should_panic(expected = "spoilt: bulk is no multiple of shear")]
fn a_multiple_of_nothing_is_no_parameter() {
    Law::of(Spoilt { prestressed: false, aligned: false, times: Some("shear") });
}
