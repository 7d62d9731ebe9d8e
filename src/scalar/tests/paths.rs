//! The evaluator on every instruction set, at lengths around its block and vector sizes.

use super::super::graph::Node;
use super::super::path::Path;
use super::super::{Lanes, Program, Real, Scalar};
use super::{every_instruction, everything};

/// Lane by lane, node by node: what the programs mean.
fn interpret(program: &Program, inputs: &[f64]) -> Vec<f64> {
    let mut values: Vec<f64> = Vec::new();
    for &node in program.nodes() {
        let at = |id: u32| values[id as usize];
        values.push(match node {
            Node::Input(n) => inputs[n as usize],
            Node::Const(bits) => f64::from_bits(bits),
            Node::Unary(op, a) => op.eval(at(a)),
            Node::Binary(op, a, b) => op.eval(at(a), at(b)),
            Node::Select(c, a, b) => at(if at(c) == 0.0 { b } else { a }),
            Node::Svd(_) | Node::Compose(..) | Node::Part(..) => unreachable!("not in these programs"),
        });
    }
    program.results().iter().map(|&id| values[id as usize]).collect()
}

/// Reproducible inputs in (−2, 2), away from whole numbers.
fn inputs(count: usize, len: usize) -> Vec<Vec<f64>> {
    let value = |i: usize| {
        let quarter = (i * 7919 % 1601) as f64 / 1601.0;
        (4.0 * quarter - 2.0) * 0.97 + 0.011
    };
    (0..count).map(|n| (0..len).map(|i| value(i * (n + 1) + 37 * n)).collect()).collect()
}

fn agree<T: Real>(program: &Program, path: Path, len: usize, tolerance: f64) {
    agree_with::<T>(program, path, len, if len % 2 == 1 { 2 } else { 0 }, tolerance);
}

/// As [`agree`], where bit n of `same` gives input n one value for all lanes.
fn agree_with<T: Real>(program: &Program, path: Path, len: usize, same: u32, tolerance: f64) {
    let x: Vec<Vec<T>> = inputs(program.inputs().len(), len)
        .into_iter()
        .map(|column| column.into_iter().map(T::from_f64).collect())
        .collect();
    let same = |n: usize| same >> n & 1 == 1;
    let given: Vec<Lanes<'_, T>> =
        (0..x.len()).map(|n| if same(n) { Lanes::Same(T::from_f64(0.83)) } else { Lanes::Each(&x[n]) }).collect();
    let mut y = vec![vec![T::from_f64(-77.0); len]; program.outputs().len()];
    let mut outputs: Vec<&mut [T]> = y.iter_mut().map(Vec::as_mut_slice).collect();
    program.run_on(path, len, &given, &mut outputs);
    for lane in 0..len {
        let at = |n: usize| if same(n) { T::from_f64(0.83) } else { x[n][lane] }.to_f64();
        let wanted = interpret(program, &(0..x.len()).map(at).collect::<Vec<_>>());
        for (j, wanted) in wanted.into_iter().enumerate() {
            let found = y[j][lane].to_f64();
            assert!(
                (found - wanted).abs() <= tolerance * (1.0 + wanted.abs()) || (found.is_nan() && wanted.is_nan()),
                "{} {} on {path:?}, lane {lane} of {len}, {}: {found:e}, wanted {wanted:e}",
                T::NAME,
                program.name(),
                program.outputs()[j]
            );
        }
    }
}

#[test]
fn every_path_agrees_with_the_definition_at_every_length() {
    let program = everything();
    for path in Path::available() {
        for len in [0, 1, 7, 255, 256, 257, 1000] {
            agree::<f32>(&program, path, len, 2e-6);
            agree::<f64>(&program, path, len, 1e-13);
            agree::<f64>(&program.vjp(), path, len, 1e-12);
        }
    }
}

#[test]
fn what_repeats_may_be_mixed_with_what_does_not() {
    let program = everything();
    for path in Path::available() {
        for same in 0..8 {
            agree_with::<f32>(&program, path, 300, same, 2e-6);
            agree_with::<f64>(&program.vjp(), path, 300, same, 1e-12);
            agree_with::<f64>(&program.vjp(), path, 300, same | 8, 1e-12);
        }
    }
}

#[test]
fn every_instruction_agrees_on_every_path() {
    for program in every_instruction() {
        for path in Path::available() {
            agree::<f32>(&program, path, 300, 2e-6);
            agree::<f64>(&program, path, 300, 1e-14);
        }
    }
}

#[test]
fn chains_of_sums_are_one_step_and_agree() {
    let first: [fn(&[Scalar]) -> Scalar; 4] =
        [|x| x[0] * x[1], |x| x[0] * x[1] + x[4], |x| x[0] * x[1] - x[4], |x| x[4] - x[0] * x[1]];
    let last: [fn(&[Scalar], Scalar) -> Scalar; 3] =
        [|x, t| x[2] * x[3] + t, |x, t| x[2] * x[3] - t, |x, t| t - x[2] * x[3]];
    for (i, first) in first.into_iter().enumerate() {
        for (j, last) in last.into_iter().enumerate() {
            let name = format!("chain_{i}_{j}");
            let program = Program::trace(&name, &["a", "b", "c", "d", "e"], &["y"], |x| vec![last(x, first(x))]);
            assert_eq!(program.code().steps.len(), 1, "{name}");
            for path in Path::available() {
                for same in [0, 0b00001, 0b01010, 0b10101, 0b11111] {
                    agree_with::<f32>(&program, path, 37, same, 1e-6);
                    agree_with::<f64>(&program, path, 300, same, 1e-15);
                }
            }
        }
    }
}

#[test]
fn min_and_max_pass_nan_on() {
    let nan = f32::NAN;
    let program = Program::trace("f", &["a", "b"], &["low", "high"], |x| vec![x[0].min(x[1]), x[0].max(x[1])]);
    for path in Path::available() {
        let (mut low, mut high) = ([0.0; 4], [0.0; 4]);
        let inputs = [Lanes::Each(&[1.0, nan, 2.0, nan][..]), Lanes::Each(&[nan, 1.0, 3.0, nan][..])];
        program.run_on(path, 4, &inputs, &mut [&mut low, &mut high]);
        assert!(low[0].is_nan() && low[1].is_nan() && low[3].is_nan() && low[2] == 2.0, "{path:?} {low:?}");
        assert!(high[0].is_nan() && high[1].is_nan() && high[3].is_nan() && high[2] == 3.0, "{path:?} {high:?}");
    }
}

#[test]
fn slots_are_reused() {
    let program = Program::trace("chain", &["x"], &["y"], |x| {
        let mut y = x[0];
        for _ in 0..100 {
            y = (y.sin() + 1.0).sqrt();
        }
        vec![y]
    });
    assert!(program.code().temporaries <= 2, "{} temporaries", program.code().temporaries);
}

#[test]
fn programs_run_on_many_threads_at_once() {
    let program = everything();
    let wanted = program.eval(&[0.3_f64, -1.2, 0.9]);
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| assert_eq!(program.clone().eval(&[0.3_f64, -1.2, 0.9]), wanted));
        }
    });
}

#[test]
#[should_panic(expected = "input b has 2 lanes, 3 wanted")]
fn a_short_input_is_refused() {
    let program = Program::trace("sum", &["a", "b"], &["c"], |x| vec![x[0] + x[1]]);
    program.run(3, &[Lanes::Same(1.0), Lanes::Each(&[1.0, 2.0])], &mut [&mut [0.0_f32; 3]]);
}

#[test]
#[should_panic(expected = "1 outputs, 2 wanted")]
fn a_missing_output_is_refused() {
    let program = Program::trace("f", &["a"], &["b", "c"], |x| vec![x[0], x[0]]);
    program.run(1, &[Lanes::Same(1.0)], &mut [&mut [0.0_f32; 1]]);
}

/// The way of one lane through a program of exactly rounded steps.
#[test]
fn arithmetic_of_one_lane_has_the_bits_of_a_run() {
    let program = Program::trace("ratio", &["x", "y"], &["z"], |v| vec![(v[0] - v[1]) * 3.1 / -(v[0] * v[1])]);
    let fused = Program::trace("fused", &["x", "y"], &["z"], |v| vec![v[0] * v[1] + v[0].exp()]);
    for (x, y) in [(0.7, 1.3), (1e-30, -3e8), (f64::NAN, 1.0), (1.0, 0.0), (f64::INFINITY, 2.0)] {
        let one = program.arithmetic(&[x, y]).expect("arithmetic alone");
        assert_eq!(one.to_bits(), program.eval(&[x, y])[0].to_bits(), "({x}, {y})");
        let narrow = [x as f32, y as f32];
        let one = program.arithmetic(&narrow).expect("arithmetic alone");
        assert_eq!(one.to_bits(), program.eval(&narrow)[0].to_bits(), "({x}, {y}) in f32");
        assert!(fused.arithmetic(&[x, y]).is_none());
    }
}
