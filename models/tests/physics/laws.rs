//! Every shipped material through the battery of checks, and a spoilt one that must not get through.

use gradreel::scalar::Mat3;
use gradreel_models::physics::{Given, Law, Material, Parameter, Point, check_material, materials};

#[test]
fn every_shipped_material_passes_the_battery() {
    for law in materials::all() {
        let report = check_material(&law).unwrap();
        println!("{report}");
        assert!(report.passed(), "{report}");
        let skipped: Vec<_> = report.checks.iter().filter(|check| check.is_skipped()).map(|check| check.name).collect();
        assert!(skipped.iter().all(|name| ["gradient on both sides of yield", "CPU and WGSL"].contains(name)));
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
    assert_eq!(failed(false, true), ["frame indifference"]);
}

#[test]
fn the_default_wave_speed_is_that_of_pressure_waves() {
    let law = Law::of(Spoilt { prestressed: false, aligned: false, times: None });
    approx::assert_relative_eq!(law.wave_speed(&[4e5], 1000.0), 20.0, max_relative = 1e-12);
}

#[test]
#[should_panic(expected = "spoilt: bulk is no multiple of shear")]
fn a_multiple_of_nothing_is_no_parameter() {
    Law::of(Spoilt { prestressed: false, aligned: false, times: Some("shear") });
}
