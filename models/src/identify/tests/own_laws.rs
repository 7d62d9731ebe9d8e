//! Laws in WGSL that are not shipped, from the tracks of their particles, each from a start that is off by a factor of two.

use super::tracks::thrown_of;
use crate::physics::Law;

/// Fits the parameters, all but those that stay; each is found within 1 %.
fn recover(name: &str, truth: &[f64], start: &[f64], fitted: &[usize]) {
    let law = Law::read(format!("../examples/laws/{name}.wgsl")).unwrap();
    let tracks = thrown_of(law, truth, [0.5, -1.8, 0.2], 12, 60);
    let found = tracks.fit([0.0; 3], start, fitted).unwrap();
    println!("{name}: {:?} (true {truth:?}), {:.1e} m", found.parameters, found.distance);
    for &k in fitted {
        let off = found.parameters[k] / truth[k] - 1.0;
        assert!(off.abs() < 0.01, "{name}: {} is {}", tracks.law.parameters()[k].name, found.parameters[k]);
    }
}

#[test]
fn ogden() {
    recover("ogden", &[8e4, 2e4, 3e5], &[4e4, 4e4, 2e5], &[0, 1, 2]);
}

#[test]
fn maxwell() {
    recover("maxwell", &[4e4, 2e5, 1e5, 0.03], &[6e4, 1.5e5, 5e4, 0.06], &[0, 1, 2, 3]);
}

#[test]
fn fibres() {
    recover("fibres", &[1e5, 0.3, 2e5], &[5e4, 0.2, 1e5], &[0, 1, 2]);
}
