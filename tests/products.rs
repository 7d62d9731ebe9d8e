//! Matrix products, linear layers and perceptrons against their definitions.

use gradreel::ops::{Activation, uniform};
use gradreel::{DType, Tape, Tensor, Var, gradcheck};
use ndarray::Array3;

fn random(seed: u64, shape: &[usize]) -> Tensor {
    uniform(seed, shape, -1.0..1.0)
}

#[track_caller]
fn close(found: &Tensor, wanted: &Tensor, tolerance: f64) {
    assert_eq!(found.shape(), wanted.shape());
    for (at, (a, b)) in found.to_vec().unwrap().into_iter().zip(wanted.to_vec().unwrap()).enumerate() {
        assert!((a - b).abs() <= tolerance * (1.0 + b.abs()), "element {at}: {a}, not {b}");
    }
}

/// Element by element, with axes of the batch that stretch.
fn by_definition(a: &Tensor, b: &Tensor, turned: [bool; 2]) -> Vec<f64> {
    let (x, y) = (a.view::<f64>(), b.view::<f64>());
    let turn = |x: ndarray::ArrayViewD<'_, f64>, turned: bool| {
        let mut x = x.into_owned();
        let rank = x.ndim();
        if turned {
            x.swap_axes(rank - 2, rank - 1);
        }
        x
    };
    let (x, y) = (turn(x, turned[0]), turn(y, turned[1]));
    let (rank, m, n) = (x.ndim().max(y.ndim()), x.shape()[x.ndim() - 2], y.shape()[y.ndim() - 1]);
    let size =
        |x: &ndarray::ArrayD<f64>, axis: usize| (axis + x.ndim()).checked_sub(rank).map_or(1, |axis| x.shape()[axis]);
    let batch: Vec<usize> = (0..rank - 2).map(|axis| size(&x, axis).max(size(&y, axis))).collect();
    let stretch = |x: &ndarray::ArrayD<f64>| {
        let mut shape = batch.clone();
        shape.extend(&x.shape()[x.ndim() - 2..]);
        let count: usize = batch.iter().product();
        let matrix = [shape[rank - 2], shape[rank - 1]];
        let wide = x.broadcast(shape).unwrap();
        Array3::from_shape_vec((count, matrix[0], matrix[1]), wide.iter().copied().collect()).unwrap()
    };
    let (x, y) = (stretch(&x), stretch(&y));
    let terms = |i: usize, r: usize, c: usize| (0..x.shape()[2]).map(|d| x[[i, r, d]] * y[[i, d, c]]).sum::<f64>();
    let place = |at: usize| terms(at / (m * n), at / n % m, at % n);
    (0..x.shape()[0] * m * n).map(place).collect()
}

#[test]
fn batches_stretch_and_either_factor_may_be_transposed() {
    let shapes: [(&[usize], &[usize]); 6] = [
        (&[3, 4], &[4, 5]),
        (&[2, 3, 4], &[4, 5]),
        (&[3, 4], &[2, 4, 5]),
        (&[2, 1, 3, 4], &[3, 4, 1]),
        (&[2, 1, 3, 40], &[1, 5, 40, 33]),
        (&[7, 1, 2, 3, 4], &[2, 1, 4, 5]),
    ];
    for (a, b) in shapes {
        for turned in [[false, false], [true, false], [false, true]] {
            let swap = |shape: &[usize], turned: bool| {
                let mut shape = shape.to_vec();
                let rank = shape.len();
                if turned {
                    shape.swap(rank - 2, rank - 1);
                }
                random(rank as u64, &shape)
            };
            let (a, b) = (swap(a, turned[0]), swap(b, turned[1]));
            let tape = Tape::new();
            let (x, y) = (tape.constant(a.clone()), tape.constant(b.clone()));
            let z = match turned {
                [true, _] => x.transposed_matmul(&y),
                [_, true] => x.matmul_transposed(&y),
                _ => x.matmul(&y),
            };
            let wanted = Tensor::from_vec(by_definition(&a, &b, turned), z.shape());
            close(z.value().unwrap(), &wanted, 1e-13);
        }
    }
}

#[test]
fn gradients_of_stretched_factors_are_summed() {
    let (a, b) = (random(1, &[2, 1, 3, 4]), random(2, &[3, 4, 2]));
    let report = gradcheck("stretched", &[("a", a), ("b", b)], |_, x| Ok(x[0].matmul(&x[1]).square())).unwrap();
    assert!(report.passed(), "{report}");
    let (a, b) = (random(1, &[2, 3, 4]), random(2, &[5, 4]));
    let report = gradcheck("one", &[("a", a), ("b", b)], |_, x| Ok(x[0].matmul_transposed(&x[1]).square())).unwrap();
    assert!(report.passed(), "{report}");
}

/// Operands of a perceptron and its result made of `linear` and the function.
fn perceptron(rows: usize, widths: &[usize]) -> Vec<Tensor> {
    let mut operands = vec![random(1, &[rows, widths[0]])];
    for (seed, pair) in (2..).step_by(2).zip(widths.windows(2)) {
        operands.extend([random(seed, &[pair[1], pair[0]]), random(seed + 1, &[pair[1]])]);
    }
    operands
}

fn fused(x: &[Var], hidden: Activation) -> Var {
    let layers: Vec<(&Var, &Var)> = x[1..].chunks(2).map(|pair| (&pair[0], &pair[1])).collect();
    x[0].mlp(&layers, hidden)
}

fn composed(x: &[Var], hidden: Activation) -> Var {
    let count = x.len() / 2;
    (0..count).fold(x[0].clone(), |h, i| {
        let h = h.linear(&x[2 * i + 1], Some(&x[2 * i + 2]));
        match hidden {
            _ if i + 1 == count => h,
            Activation::Identity => h,
            Activation::Relu => h.relu(),
            Activation::Tanh => h.tanh(),
            Activation::Logistic => h.logistic(),
            Activation::Softplus => h.softplus(),
            Activation::Silu => h.silu(),
        }
    })
}

/// Result and gradients of `Σ y²`.
fn slopes(operands: &[Tensor], net: impl Fn(&[Var]) -> Var) -> Vec<Tensor> {
    let tape = Tape::new();
    let x: Vec<Var> = operands.iter().map(|x| tape.leaf(x.clone())).collect();
    let y = net(&x);
    let found = y.square().sum_all().backward().unwrap();
    std::iter::once(y.value().unwrap().clone()).chain(x.iter().map(|x| found.wrt(x).unwrap().clone())).collect()
}

#[test]
fn a_perceptron_is_its_layers() {
    // rows beyond one block and one span; widths that are no whole vectors; layers that are kept
    let kept = vec![5, 64, 80, 32, 3];
    for (rows, widths) in [(5001, vec![3, 20, 17, 2]), (300, vec![39, 33]), (1, vec![2, 1, 3]), (700, kept)] {
        for hidden in [Activation::Relu, Activation::Tanh, Activation::Logistic, Activation::Softplus, Activation::Silu]
        {
            let operands = perceptron(rows, &widths);
            let found = slopes(&operands, |x| fused(x, hidden));
            let wanted = slopes(&operands, |x| composed(x, hidden));
            for (a, b) in found.iter().zip(&wanted) {
                close(a, b, 1e-10);
            }
        }
    }
}

#[test]
fn a_perceptron_is_differentiated_twice() {
    let operands = perceptron(5, &[3, 4, 2]);
    let curvature = |net: &dyn Fn(&[Var]) -> Var| {
        let tape = Tape::new();
        let x: Vec<Var> = operands.iter().map(|x| tape.leaf(x.clone())).collect();
        let slope = net(&x).square().sum_all().gradients_of(&[&x[0]]).unwrap();
        let found = slope[0].square().sum_all().backward().unwrap();
        [0, 1, 3].map(|i| found.wrt(&x[i]).unwrap().clone())
    };
    let found = curvature(&|x| fused(x, Activation::Tanh));
    for (a, b) in found.iter().zip(&curvature(&|x| composed(x, Activation::Tanh))) {
        close(a, b, 1e-12);
    }
}

#[test]
fn the_number_of_threads_changes_no_bit_of_a_perceptron() {
    let operands: Vec<Tensor> =
        perceptron(9000, &[13, 40, 3]).into_iter().map(|x| x.cast(DType::F32).unwrap()).collect();
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            slopes(&operands, |x| fused(x, Activation::Relu)).iter().map(Tensor::to_vec).collect::<Vec<_>>()
        })
    };
    let one: Vec<_> = on(1).into_iter().map(Result::unwrap).collect();
    for threads in [2, 5] {
        assert!(on(threads).into_iter().map(Result::unwrap).eq(one.iter().cloned()), "{threads} threads");
    }
}

#[test]
#[should_panic(expected = "mlp: the operands do not fit")]
fn a_perceptron_whose_layers_do_not_fit_is_refused() {
    let tape = Tape::new();
    let x: Vec<Var> = perceptron(4, &[3, 5, 2]).into_iter().map(|x| tape.constant(x)).collect();
    let _ = x[0].mlp(&[(&x[1], &x[2]), (&x[1], &x[2])], Activation::Relu);
}
