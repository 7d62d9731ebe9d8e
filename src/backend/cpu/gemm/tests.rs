use super::{Activation, Gemm, Out, Panel, Par, Strided};
use crate::Key;
use crate::scalar::Real;

fn numbers<T: Real>(seed: u64, len: usize) -> Vec<T> {
    Key::new(seed).uniform(len).map(|u| T::from_f64(2.0 * u - 1.0)).collect()
}

/// The product in `f64`, one sum after another.
fn naive<T: Real>(a: Strided<'_, T>, b: Strided<'_, T>, [m, k, n]: [usize; 3]) -> Vec<f64> {
    let term = |i: usize, d: usize, j: usize| {
        a.values[i * a.line + d * a.depth].to_f64() * b.values[j * b.line + d * b.depth].to_f64()
    };
    let element = |i: usize, j: usize| (0..k).map(|d| term(i, d, j)).sum::<f64>();
    (0..m).flat_map(|i| (0..n).map(move |j| element(i, j))).collect()
}

#[track_caller]
fn close<T: Real>(found: T, wanted: f64, k: usize, what: &str) {
    let bound = 16.0 * T::EPSILON.to_f64() * (k as f64 + 4.0).sqrt() * (1.0 + wanted.abs());
    assert!((found.to_f64() - wanted).abs() <= bound, "{what}: {found}, not {wanted}");
}

/// Both layouts of each factor.
fn layouts<T: Real>(values: &[T], lines: usize, depth: usize) -> [Strided<'_, T>; 2] {
    [Strided::lines(values, depth), Strided::side_by_side(values, lines)]
}

const SHAPES: [[usize; 3]; 18] = [
    [1, 1, 1],
    [1, 7, 9],
    [9, 7, 1],
    [3, 4, 5],
    [14, 8, 32],
    [15, 385, 33],
    [28, 193, 16],
    [13, 17, 47],
    [5, 0, 6],
    [100, 39, 128],
    [128, 1000, 3],
    [1, 300, 700],
    [700, 300, 1],
    [37, 5000, 21],
    [2100, 11, 4],
    [60, 400, 650],
    [150, 129, 131],
    [120, 400, 650],
];

fn products<T: Real>() {
    for sizes @ [m, k, n] in SHAPES {
        let (a, b) = (numbers::<T>(1, m * k), numbers::<T>(2, k * n));
        for (x, left) in layouts(&a, m, k).into_iter().enumerate() {
            for (y, right) in layouts(&b, n, k).into_iter().enumerate() {
                let wanted = naive(left, right, sizes);
                for (row, column, par) in [
                    (n, 1, Par::Threads),
                    (1, m, Par::Sequential),
                    (2 * n + 3, 2, Par::Sequential),
                    (n + 5, 1, Par::Threads),
                ] {
                    let mut out = vec![T::from_f64(7.0); (m - 1) * row + (n - 1) * column + 1];
                    Gemm::new(sizes).run(&left, &right, Out::strided(&mut out, row, column), par);
                    let what = format!("{sizes:?}, factors {x} {y}, distances {row} {column}");
                    let mut touched = 0;
                    for (i, wanted) in wanted.iter().enumerate() {
                        close(out[i / n * row + i % n * column], *wanted, k, &what);
                        touched += 1;
                    }
                    let kept = out.iter().filter(|v| v.to_f64() == 7.0).count();
                    assert_eq!(kept + touched, out.len(), "{what}: something else was written");
                }
            }
        }
    }
}

#[test]
fn products_of_all_layouts_are_those_of_the_definition() {
    products::<f32>();
    products::<f64>();
}

/// An activation with its definition.
type Defined = (Activation, fn(f64) -> f64);

#[test]
fn scale_accumulation_biases_and_activation_come_in_their_order() {
    let functions: [Defined; 6] = [
        (Activation::Identity, |x| x),
        (Activation::Relu, |x| x.max(0.0)),
        (Activation::Tanh, f64::tanh),
        (Activation::Logistic, |x| 1.0 / (1.0 + (-x).exp())),
        (Activation::Softplus, |x| x.exp().ln_1p()),
        (Activation::Silu, |x| x / (1.0 + (-x).exp())),
    ];
    for sizes @ [m, k, n] in SHAPES {
        let (a, b) = (numbers::<f32>(1, m * k), numbers::<f32>(2, k * n));
        let (rows, columns) = (numbers::<f32>(3, m), numbers::<f32>(4, n));
        let before = numbers::<f32>(5, m * n);
        let (left, right) = (Strided::lines(&a, k), Strided::side_by_side(&b, n));
        let products = naive(left, right, sizes);
        for (activation, function) in functions {
            for transposed in [false, true] {
                let mut out = before.clone();
                let place = if transposed { Out::strided(&mut out, 1, m) } else { Out::rows(&mut out, n) };
                let gemm = Gemm { scale: 0.5, ..Gemm::new(sizes) }
                    .accumulate()
                    .row_bias(Some(&rows))
                    .column_bias(Some(&columns));
                gemm.activation(activation).run(&left, &right, place, Par::Threads);
                for i in 0..m * n {
                    let at = if transposed { i % n * m + i / n } else { i };
                    let sum =
                        f64::from(before[at]) + 0.5 * products[i] + f64::from(rows[i / n]) + f64::from(columns[i % n]);
                    close(out[at], function(sum), k, &format!("{sizes:?} {activation:?} {transposed}"));
                }
            }
        }
    }
}

/// The same numbers from a closure, so that nothing can be read in place.
struct Computed<F>(F);

impl<T: Real, F: Fn(usize, usize) -> T + Sync> Panel<T> for Computed<F> {
    fn pack(&self, lines: std::ops::Range<usize>, depth: std::ops::Range<usize>, width: usize, into: &mut [T]) {
        for (row, d) in into.chunks_exact_mut(width).zip(depth) {
            lines.clone().zip(row).for_each(|(l, to)| *to = self.0(l, d));
        }
    }
}

#[test]
fn a_factor_may_be_made_while_it_is_packed() {
    for sizes @ [m, k, n] in SHAPES {
        let (a, b) = (numbers::<f32>(1, m * k), numbers::<f32>(2, k * n));
        let wanted = naive(Strided::lines(&a, k), Strided::side_by_side(&b, n), sizes);
        let (left, right) = (Computed(|i, d| a[i * k + d]), Computed(|j, d| b[d * n + j]));
        let mut out = vec![0.0; m * n];
        Gemm::new(sizes).run(&left, &right, Out::rows(&mut out, n), Par::Threads);
        out.iter().zip(wanted).for_each(|(&x, y)| close(x, y, k, &format!("{sizes:?}")));
    }
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    for sizes @ [m, k, n] in [[300, 400, 310], [128, 9000, 39], [5000, 128, 35], [35, 128, 5000]] {
        let (a, b) = (numbers::<f32>(1, m * k), numbers::<f32>(2, k * n));
        let bias = numbers::<f32>(3, n);
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut out = vec![0.0; m * n];
            let gemm = Gemm::new(sizes).column_bias(Some(&bias)).activation(Activation::Silu);
            let (left, right) = (Strided::lines(&a, k), Strided::side_by_side(&b, n));
            pool.install(|| gemm.run(&left, &right, Out::rows(&mut out, n), Par::Threads));
            out
        };
        let one = on(1);
        assert!([2, 3, 5].into_iter().all(|threads| on(threads) == one), "{sizes:?}");
    }
}

#[test]
#[should_panic(expected = "overlap")]
fn an_output_that_overlaps_itself_is_refused() {
    let x = [1.0f32; 4];
    Gemm::new([2, 2, 2]).run(
        &Strided::lines(&x, 2),
        &Strided::lines(&x, 2),
        Out::strided(&mut [0.0; 4], 1, 1),
        Par::Threads,
    );
}

#[test]
fn nan_and_infinity_reach_the_product() {
    for poison in [f32::NAN, f32::INFINITY] {
        let mut a = vec![0.0f32; 20 * 10];
        a[7 * 10 + 3] = poison;
        let (b, mut out) = (vec![1.0; 10 * 5], vec![0.0; 20 * 5]);
        let gemm = Gemm::new([20, 10, 5]).activation(Activation::Relu);
        gemm.run(&Strided::lines(&a, 10), &Strided::lines(&b, 10), Out::rows(&mut out, 5), Par::Threads);
        assert!((0..100).all(|i| out[i].is_finite() == (i / 5 != 7)), "{out:?}");
    }
}
