//! Every path against the definition, over sizes that no tile divides.

use super::walk::Walk;
use super::winograd::Plan;
use super::{direct, gradient, karatsuba, product};
use crate::ops::Geometry;
use crate::random::Key;

/// The definition: for each result, weight and pixel that belong together.
fn each(g: &Geometry, mut add: impl FnMut(usize, usize, usize)) {
    let [pixels, places, volume] = g.volumes();
    let at =
        |number: usize, size: [usize; 3]| [number / size[2] / size[1], number / size[2] % size[1], number % size[2]];
    for (n, channel, input) in (0..g.batch)
        .flat_map(|n| (0..g.groups * g.outputs).map(move |o| (n, o)))
        .flat_map(|(n, o)| (0..g.inputs).map(move |i| (n, o, i)))
    {
        for place in 0..places {
            for tap in 0..volume {
                let (p, k) = (at(place, g.y), at(tap, g.kernel));
                let pixel = [0, 1, 2].map(|a| {
                    (p[a] * g.stride[a] + k[a] * g.dilation[a]).checked_sub(g.padding[a]).filter(|&x| x < g.x[a])
                });
                let [Some(d), Some(h), Some(w)] = pixel else { continue };
                let plane = (n * g.groups + channel / g.outputs) * g.inputs + input;
                let y = (n * g.groups * g.outputs + channel) * places + place;
                let x = plane * pixels + (d * g.x[1] + h) * g.x[2] + w;
                add(y, (channel * g.inputs + input) * volume + tap, x);
            }
        }
    }
}

fn numbers(seed: u64, len: usize) -> Vec<f64> {
    Key::new(seed).uniform(len).map(|u| 2.0 * u - 1.0).collect()
}

#[track_caller]
fn assert_close(what: &str, g: &Geometry, found: &[f64], wanted: &[f64]) {
    assert_eq!(found.len(), wanted.len(), "{what} of {g:?}");
    let off = found
        .iter()
        .zip(wanted)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, |m: f64, e| if e > m || e.is_nan() { e } else { m });
    assert!(off < 1e-11, "{what} of {g:?} is off by {off}");
}

fn check(g: &Geometry) {
    let [pixels, places, volume] = g.volumes();
    let [inputs, outputs] = [g.groups * g.inputs, g.groups * g.outputs];
    let x = numbers(1, g.batch * inputs * pixels);
    let w = numbers(2, outputs * g.inputs * volume);
    let y = numbers(3, g.batch * outputs * places);
    let (y_bias, x_bias) = (numbers(4, outputs), numbers(5, inputs));
    let mut to_y: Vec<_> = (0..y.len()).map(|i| y_bias[i / places % outputs]).collect();
    let mut to_x: Vec<_> = (0..x.len()).map(|i| x_bias[i / pixels % inputs]).collect();
    let mut to_w = vec![0.0; w.len()];
    each(g, |i, j, k| {
        to_y[i] += w[j] * x[k];
        to_x[k] += w[j] * y[i];
        to_w[j] += y[i] * x[k];
    });
    let (walk, walks) = (Walk::forward(g), Walk::transposed(g));
    assert_close("direct", g, &direct::forward(g, &walk, &x, &w, Some(&y_bias)), &to_y);
    assert_close("direct, transposed", g, &direct::transposed(g, &walks, &y, &w, Some(&x_bias)), &to_x);
    assert_close("direct, weights", g, &direct::weights(g, &walk, &walk.pad(&x), &y), &to_w);
    assert_close("product", g, &product::forward(g, &walk, &x, &w, Some(&y_bias)), &to_y);
    assert_close("product, transposed", g, &product::transposed(g, &walks, &y, &w, Some(&x_bias)), &to_x);
    assert_close("gradient", g, &gradient::weights(g, &walk, &x, &y), &to_w);
    let at = |o: usize, i: usize, tap: usize| (o * g.inputs + i) * volume + 9 * tap;
    if let Some(plan) = Plan::new(g, &walk, false) {
        assert_close("winograd", g, &plan.run(&x, &w, |i, o, tap| at(o, i, tap), false, Some(&y_bias)), &to_y);
        assert_close("winograd, weights", g, &plan.weights(&x, &y), &to_w);
    }
    if let [walk] = &walks[..]
        && let Some(plan) = Plan::new(g, walk, true)
    {
        assert_close("winograd, transposed", g, &plan.run(&y, &w, at, true, Some(&x_bias)), &to_x);
    }
    if let Some(plan) = karatsuba::Plan::new(g) {
        assert_close("karatsuba, transposed", g, &plan.enlarge(&y, &w, Some(&x_bias)), &to_x);
        assert_close("karatsuba, weights", g, &plan.weights(&x, &y), &to_w);
    }
}

/// A geometry with as many places as fit, less `left_out` along the last axis.
fn geometry(
    counts: [usize; 4],
    x: [usize; 3],
    kernel: [usize; 3],
    settings: [[usize; 3]; 3],
    left_out: usize,
) -> Geometry {
    let ([batch, groups, inputs, outputs], [stride, padding, dilation]) = (counts, settings);
    let mut y = [0, 1, 2].map(|a| (x[a] + 2 * padding[a] - dilation[a] * (kernel[a] - 1) - 1) / stride[a] + 1);
    y[2] -= left_out;
    Geometry { batch, groups, inputs, outputs, x, y, kernel, stride, padding, dilation }
}

const ONE: [usize; 3] = [1; 3];
const NONE: [usize; 3] = [0; 3];

#[test]
fn any_geometry() {
    let cases = [
        geometry([2, 1, 3, 5], [1, 9, 7], [1, 3, 3], [ONE, [0, 1, 1], ONE], 0),
        geometry([1, 1, 7, 6], [1, 1, 19], [1, 1, 5], [[1, 1, 2], [0, 0, 2], ONE], 0),
        geometry([3, 2, 5, 7], [1, 6, 5], [1, 1, 1], [ONE, NONE, ONE], 0),
        geometry([1, 1, 20, 9], [1, 6, 37], [1, 1, 1], [ONE, NONE, ONE], 0),
        geometry([2, 2, 6, 5], [1, 8, 9], [1, 3, 2], [[1, 2, 3], [0, 2, 1], [1, 1, 2]], 0),
        geometry([1, 4, 1, 1], [5, 6, 40], [3, 3, 3], [ONE, ONE, ONE], 0),
        geometry([2, 1, 8, 6], [4, 5, 6], [3, 3, 3], [[2; 3], ONE, ONE], 0),
        geometry([1, 1, 5, 16], [6, 5, 4], [2, 3, 1], [[1, 2, 3], [1, 1, 0], [3, 2, 1]], 0),
        geometry([1, 1, 5, 5], [1, 4, 9], [1, 2, 2], [[1, 3, 4], NONE, ONE], 0),
        geometry([2, 1, 5, 6], [1, 5, 12], [1, 2, 2], [[1, 1, 2], NONE, [1, 3, 4]], 1),
        geometry([2, 1, 33, 40], [1, 18, 19], [1, 3, 3], [ONE, [0, 1, 1], ONE], 0),
        geometry([0, 1, 5, 6], [1, 5, 5], [1, 3, 3], [ONE, NONE, ONE], 0),
    ];
    cases.iter().for_each(check);
}

#[test]
fn squares_of_results() {
    let planned = |g: &Geometry| Plan::new(g, &Walk::forward(g), false).is_some();
    let cases = [
        geometry([1, 1, 16, 16], [1, 14, 16], [1, 3, 3], [ONE, [0, 1, 1], ONE], 0),
        geometry([3, 1, 17, 20], [1, 9, 11], [1, 3, 3], [ONE, [0, 2, 0], ONE], 0),
        geometry([2, 1, 16, 18], [3, 15, 14], [1, 3, 3], [ONE, [0, 0, 3], ONE], 0),
        geometry([2, 1, 16, 16], [2, 15, 14], [1, 3, 3], [ONE, [1, 1, 1], ONE], 0),
        geometry([2, 1, 18, 16], [4, 14, 15], [3, 3, 3], [ONE, ONE, ONE], 0),
        geometry([1, 1, 16, 33], [7, 14, 16], [2, 3, 3], [ONE, [2, 1, 0], [3, 1, 1]], 1),
    ];
    for g in &cases {
        assert!(planned(g), "{g:?}");
        check(g);
    }
}

#[test]
fn pairs_of_places() {
    let two = [2; 3];
    let cases = [
        geometry([1, 1, 32, 33], [22, 20, 24], [3, 3, 3], [two, ONE, ONE], 0),
        geometry([2, 1, 34, 32], [21, 19, 25], [3, 3, 3], [two, ONE, ONE], 0),
        geometry([1, 1, 32, 32], [23, 21, 24], [3, 3, 3], [two, NONE, ONE], 0),
        geometry([1, 1, 33, 36], [21, 20, 23], [3, 3, 3], [two, [0, 2, 1], ONE], 1),
        // more than one slab
        geometry([1, 1, 33, 32], [20, 36, 40], [3, 3, 3], [two, ONE, ONE], 0),
    ];
    for g in &cases {
        assert!(karatsuba::Plan::<f64>::new(g).is_some(), "{g:?}");
        check(g);
    }
}
