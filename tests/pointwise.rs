//! Pointwise ops, reductions, scans and gathers against PyTorch in double precision, and functions composed of them.

use gradreel::io::safetensors::TensorFile;
use gradreel::{DType, ErrorKind, Result, Tape, Tensor, Var, gradcheck};

/// Values and gradients of `tests/vectors/pointwise.py`.
struct Vectors(TensorFile);

impl Vectors {
    fn read() -> Self {
        Self(TensorFile::read("tests/vectors/pointwise.safetensors").unwrap())
    }

    /// Compares a function of the case's operands, in `f64` and `f32`.
    fn check(&self, name: &str, function: impl Fn(&[Var]) -> Var) {
        for (dtype, tolerance) in [(DType::F64, 1e-12), (DType::F32, 4e-6)] {
            let tape = Tape::new();
            let get = |part: &str| self.0.get(&format!("{name}.{part}")).unwrap();
            let operands: Vec<(Var, Option<&str>)> = ["x", "b", "i"]
                .into_iter()
                .zip([Some("g"), Some("gb"), None])
                .filter_map(|(part, gradient)| {
                    let value = self.0.tensors.get(&format!("{name}.{part}"))?;
                    Some(match gradient {
                        Some(_) => (tape.leaf(value.cast(dtype).unwrap()), gradient),
                        None => (tape.constant(value.clone()), None),
                    })
                })
                .collect();
            let inputs: Vec<Var> = operands.iter().map(|(x, _)| x.clone()).collect();
            let y = function(&inputs);
            let close = |found: &Tensor, part: &str| {
                let wanted = get(part);
                assert_eq!(found.shape(), wanted.shape(), "{name}.{part}");
                let scale = wanted.slice::<f64>().iter().fold(1.0f64, |m, v| m.max(v.abs()));
                for (at, (a, b)) in found.to_vec().unwrap().iter().zip(wanted.slice::<f64>()).enumerate() {
                    assert!((a - b).abs() <= tolerance * scale, "{name}.{part}[{at}] in {dtype}: {a}, PyTorch {b}");
                }
            };
            close(y.value().unwrap(), "y");
            let weights = tape.constant(get("w").cast(dtype).unwrap());
            let gradients = (&y * weights).sum_all().backward().unwrap();
            for (x, part) in &operands {
                if let Some(part) = part {
                    close(gradients.wrt(x).unwrap(), part);
                }
            }
        }
    }
}

#[test]
fn pytorch_agrees_on_pointwise_functions() {
    let vectors = Vectors::read();
    vectors.check("silu", |v| v[0].silu());
    vectors.check("gelu", |v| v[0].gelu());
    vectors.check("gelu_tanh", |v| v[0].gelu_tanh());
    vectors.check("gelu_sigmoid", |v| v[0].gelu_sigmoid());
    vectors.check("erf", |v| v[0].erf());
    vectors.check("elu", |v| v[0].elu(0.7));
    vectors.check("leaky_relu", |v| v[0].leaky_relu(0.2));
    vectors.check("clamp", |v| v[0].clamp(-1.25, 2.5));
    vectors.check("sin", |v| v[0].sin());
    vectors.check("cos", |v| v[0].cos());
    vectors.check("pow_3", |v| v[0].pow(3.0));
    vectors.check("pow_2.4", |v| v[0].pow(2.4));
    vectors.check("exp_m1", |v| v[0].exp_m1());
    vectors.check("ln_1p", |v| v[0].ln_1p());
    vectors.check("rsqrt", |v| v[0].rsqrt());
    vectors.check("recip", |v| v[0].recip());
    vectors.check("choose", |v| v[0].gt(&(0.0 * &v[0])).choose(&v[0], &v[1]));
}

#[test]
fn pytorch_agrees_on_reductions_and_scans() {
    let vectors = Vectors::read();
    vectors.check("logsumexp", |v| (&v[0] * 300.0).logsumexp(&[2, 0]));
    vectors.check("variance", |v| v[0].variance(&[0, 2], 1));
    vectors.check("max", |v| v[0].max(&[1]));
    vectors.check("min", |v| v[0].min(&[1]));
    vectors.check("max_ties", |v| v[0].max(&[1]));
    vectors.check("prod", |v| v[0].prod(&[1]));
    vectors.check("cumsum", |v| v[0].cumsum(1));
    vectors.check("cumsum", |v| v[0].flip(1).cumsum_from_end(1).flip(1));
    vectors.check("cumprod", |v| v[0].cumprod(1));
    vectors.check("cumprod", |v| v[0].flip(1).cumprod_from_end(1).flip(1));
}

#[test]
fn pytorch_agrees_on_gathers_and_encodings() {
    let vectors = Vectors::read();
    vectors.check("gather", |v| v[0].gather(1, &v[1]).unwrap());
    vectors.check("scatter_add", |v| v[0].scatter_add(1, &v[2], &v[1]).unwrap());
    let tape = Tape::new();
    for size in [8, 9] {
        let get = |part: &str| vectors.0.get(&format!("sinusoid_{size}.{part}")).unwrap();
        vectors.check_values(&tape.constant(get("x").clone()).sinusoid(size), get("y"));
    }
}

impl Vectors {
    fn check_values(&self, found: &Var, wanted: &Tensor) {
        for (a, b) in found.value().unwrap().slice::<f64>().iter().zip(wanted.slice::<f64>()) {
            assert!((a - b).abs() < 1e-12, "{a} {b}");
        }
    }
}

/// Whole numbers, so that every order of additions is exact.
fn whole(shape: &[usize]) -> Tensor {
    let len = shape.iter().product::<usize>();
    Tensor::from_vec((0..len).map(|i| (i * 7919 % 23) as f32 - 11.0).collect(), shape)
}

#[test]
fn reductions_of_any_shape_fold_every_element_once() {
    let shapes: [&[usize]; 14] = [
        &[0],
        &[1],
        &[33],
        &[200_003],
        &[3, 70_001],
        &[70_001, 3],
        &[150_000, 2],
        &[2, 40_000, 3],
        &[300, 2000],
        &[5, 1, 7, 33, 2],
        &[2, 0, 3],
        &[40, 65, 40],
        &[2, 3, 4, 5, 6, 7],
        &[1025, 1030],
    ];
    for shape in shapes {
        for mask in 0..1usize << shape.len() {
            let axes: Vec<usize> = (0..shape.len()).filter(|axis| mask >> axis & 1 == 1).collect();
            let x = whole(shape);
            let kept: Vec<usize> = (0..shape.len()).filter(|axis| !axes.contains(axis)).collect();
            let sizes: Vec<usize> = kept.iter().map(|&axis| shape[axis]).collect();
            let mut wanted = vec![(0.0, f32::NEG_INFINITY, f32::INFINITY); sizes.iter().product()];
            for (flat, &v) in x.slice::<f32>().iter().enumerate() {
                let place = x.shape().index(flat);
                let at = kept.iter().fold(0, |at, &axis| at * shape[axis] + place[axis]);
                let (sum, high, low) = wanted[at];
                wanted[at] = (sum + v, f32::max(high, v), f32::min(low, v));
            }
            let var = Tape::new().constant(x);
            let same = |found: Var, pick: fn(&(f32, f32, f32)) -> f32| {
                assert_eq!(found.dims(), sizes);
                let wanted: Vec<f32> = wanted.iter().map(pick).collect();
                assert!(found.value().unwrap().slice::<f32>() == wanted, "{shape:?} over {axes:?}");
            };
            same(var.sum(&axes), |w| w.0);
            if !var.is_empty() {
                same(var.max(&axes), |w| w.1);
                same(var.min(&axes), |w| w.2);
            }
        }
    }
}

#[test]
fn sums_keep_their_digits_and_do_not_depend_on_the_number_of_threads() {
    let x = gradreel::ops::uniform(1, [3, 100_001, 2], 0.0..1.0).cast(DType::F32).unwrap();
    let all = || {
        let x = Tape::new().constant(x.clone());
        [vec![0, 1, 2], vec![1], vec![0, 1], vec![1, 2]].map(|axes| x.sum(&axes).value().unwrap().clone())
    };
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap().install(all);
    let four = rayon::ThreadPoolBuilder::new().num_threads(4).build().unwrap().install(all);
    for (one, four) in one.iter().zip(&four) {
        assert_eq!(one.slice::<f32>(), four.slice::<f32>());
    }
    let exact: f64 = x.slice::<f32>().iter().map(|v| f64::from(*v)).sum();
    assert_eq!(one[0].slice::<f32>()[0], exact as f32);
}

#[test]
fn extrema_keep_nan_and_find_the_first() {
    let tape = Tape::new();
    let x = tape.leaf(Tensor::from_vec(vec![1.0f64, f64::NAN, 3.0, 7.0, 2.0, 7.0], [2, 3]));
    let (high, low) = (x.max(&[1]), x.min(&[1]));
    assert!(high.value().unwrap().slice::<f64>()[0].is_nan() && low.value().unwrap().slice::<f64>()[0].is_nan());
    assert_eq!(high.value().unwrap().slice::<f64>()[1], 7.0);
    assert_eq!(x.argmax(1).value().unwrap().slice::<u32>(), &[1, 0]);
    assert_eq!(x.argmin(1).value().unwrap().slice::<u32>(), &[1, 1]);
    let gradients = high.sum_all().backward().unwrap();
    assert_eq!(gradients.wrt(&x).unwrap().slice::<f64>(), &[0.0, 1.0, 0.0, 1.0, 0.0, 0.0]);
}

#[test]
fn comparisons_with_nan_are_false() {
    let tape = Tape::new();
    for dtype in [DType::F32, DType::F64] {
        let numbers = |values: Vec<f64>| tape.constant(Tensor::from_vec(values, [4]).cast(dtype).unwrap());
        let a = numbers(vec![1.0, 2.0, f64::NAN, f64::NAN]);
        let b = numbers(vec![2.0, 2.0, 1.0, f64::NAN]);
        let truth = |x: Var| x.value().unwrap().to_vec().unwrap();
        assert_eq!(truth(a.lt(&b)), [1.0, 0.0, 0.0, 0.0]);
        assert_eq!(truth(a.le(&b)), [1.0, 1.0, 0.0, 0.0]);
        assert_eq!(truth(a.gt(&b)), [0.0, 0.0, 0.0, 0.0]);
        assert_eq!(truth(a.ge(&b)), [0.0, 1.0, 0.0, 0.0]);
        assert_eq!(truth(a.eq(&b)), [0.0, 1.0, 0.0, 0.0]);
        assert_eq!(truth(a.ne(&b)), [1.0, 0.0, 1.0, 1.0]);
    }
}

#[test]
fn nothing_leaks_out_of_the_branch_not_taken() {
    let tape = Tape::new();
    let mask = tape.constant(Tensor::from_vec(vec![1.0f64, 0.0], [2]));
    let a = tape.leaf(Tensor::from_vec(vec![2.0f64, f64::NAN], [2]));
    let b = tape.leaf(Tensor::from_vec(vec![f64::INFINITY, 3.0], [2]));
    let y = mask.choose(&a, &b);
    assert_eq!(y.value().unwrap().slice::<f64>(), &[2.0, 3.0]);
    let gradients = y.sum_all().backward().unwrap();
    assert_eq!(gradients.wrt(&a).unwrap().slice::<f64>(), &[1.0, 0.0]);
    assert_eq!(gradients.wrt(&b).unwrap().slice::<f64>(), &[0.0, 1.0]);
}

/// Checks the gradient of a function of one `[2, 3, 4]` tensor, and the gradient of its gradient.
fn check_twice(name: &str, function: impl Fn(&Var) -> Var) {
    let x = gradreel::ops::uniform(5, [2, 3, 4], 0.2..1.8);
    let report = gradcheck(name, &[("x", x.clone())], |_, v| Ok(function(&v[0]))).unwrap();
    assert!(report.passed(), "{report}");
    let slope = |_: &Tape, v: &[Var]| -> Result<Var> {
        // a leaf of its own, on the same tape, so that the gradient is a function of v[0]
        let y = function(&v[0]).square().sum_all();
        match v[0].is_differentiable() {
            true => Ok(y.gradients_of(&[&v[0]])?.remove(0)),
            false => {
                let tape = Tape::new();
                let x = tape.leaf(v[0].value()?.clone());
                let y = function(&x).square().sum_all();
                Ok(v[0].tape().constant(y.backward()?.wrt(&x)?.clone()))
            }
        }
    };
    let report = gradcheck(&format!("gradient of {name}"), &[("x", x)], slope).unwrap();
    assert!(report.passed(), "{report}");
}

#[test]
fn composed_functions_can_be_differentiated_twice() {
    check_twice("logsumexp", |x| x.logsumexp(&[0, 2]));
    check_twice("variance", |x| x.variance(&[1], 0));
    check_twice("prod", |x| x.prod(&[0, 2]));
    check_twice("cumprod", |x| x.cumprod(2));
    check_twice("cumprod_from_end", |x| x.cumprod_from_end(0));
    check_twice("max", |x| x.square().max(&[2]));
    check_twice("flip and roll", |x| x.flip(1).roll(2, -1) * x);
    check_twice("stack", |x| x.stack(&[&x.square()], 1).transpose(0, 1).flatten(1..3));
    check_twice("repeat", |x| x.repeat(&[2, 1, 3]));
    check_twice("split", |x| {
        let parts = x.split(2, &[1, 3]);
        &parts[0] * &parts[1]
    });
    check_twice("positional_encoding", |x| x.positional_encoding(3));
    check_twice("broadcast", |x| x * x.slice(1, 0..1) + x.slice(0, 1..2).slice(2, 1..2) * x.select(0, 1));
    let index = |tape: &Tape, values: Vec<u32>, shape: &[usize]| tape.constant(Tensor::from_vec(values, shape));
    check_twice("select_along", |x| x.select_along(1, &index(x.tape(), vec![2, 0, 2, 2], &[4])).unwrap());
    check_twice("gather", |x| x.gather(2, &index(x.tape(), vec![3, 0, 1, 1], &[2, 1, 2])).unwrap());
    check_twice("scatter_add", |x| {
        let values = x.slice(0, 0..1).slice(1, 0..2).slice(2, 0..2);
        x.scatter_add(2, &index(x.tape(), vec![3, 0, 0, 0], &[1, 2, 2]), &values).unwrap()
    });
}

#[test]
fn structure_moves_elements_to_their_places() {
    let tape = Tape::new();
    let x = tape.constant(Tensor::from_vec((0..6).map(|i| i as f32).collect(), [2, 3]));
    let values = |x: Var| x.value().unwrap().slice::<f32>().to_vec();
    assert_eq!(values(x.flip(1)), [2.0, 1.0, 0.0, 5.0, 4.0, 3.0]);
    assert_eq!(values(x.roll(1, 1)), [2.0, 0.0, 1.0, 5.0, 3.0, 4.0]);
    assert_eq!(values(x.roll(0, -3)), [3.0, 4.0, 5.0, 0.0, 1.0, 2.0]);
    assert_eq!(values(x.transpose(0, 1)), [0.0, 3.0, 1.0, 4.0, 2.0, 5.0]);
    assert_eq!(values(x.repeat(&[1, 2])), [0.0, 1.0, 2.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 3.0, 4.0, 5.0]);
    assert_eq!(values(x.stack(&[&x], 2)), [0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0, 5.0, 5.0]);
    assert_eq!(x.unsqueeze(1).dims(), &[2, 1, 3]);
    assert_eq!(x.unsqueeze(2).squeeze(2).dims(), &[2, 3]);
    assert_eq!(x.unsqueeze(0).flatten(0..2).dims(), &[2, 3]);
    assert_eq!(values(x.chunk(1, 3).remove(2)), [2.0, 5.0]);
    let index = tape.constant(Tensor::from_vec(vec![2u32, 0], [2]));
    assert_eq!(values(index.one_hot(3, DType::F32).unwrap()), [0.0, 0.0, 1.0, 1.0, 0.0, 0.0]);
    assert_eq!(x.positional_encoding(2).dims(), &[2, 15]);
}

#[test]
fn an_index_outside_is_named_with_its_place_and_bound() {
    let tape = Tape::new();
    let x = tape.constant(Tensor::zeros([2, 3], DType::F32));
    let index = |values: Vec<u32>, shape: &[usize]| tape.constant(Tensor::from_vec(values, shape));
    let errors = [
        x.gather(1, &index(vec![0, 1, 2, 3], &[2, 2])).err().unwrap(),
        x.scatter_add(1, &index(vec![0, 1, 2, 3], &[2, 2]), &x.slice(1, 0..2)).err().unwrap(),
        x.select_along(1, &index(vec![0, 3], &[2])).err().unwrap(),
        index(vec![0, 3], &[2]).one_hot(3, DType::F32).err().unwrap(),
    ];
    for (error, place) in errors.iter().zip(["index[1, 1]", "index[1, 1]", "index[1]", "index[1]"]) {
        assert_eq!(error.kind(), ErrorKind::Input);
        let text = error.to_string();
        assert!(text.contains(place) && text.contains("below 3"), "{text}");
    }
}

#[test]
#[should_panic(expected = "max of no elements does not exist")]
fn the_largest_of_nothing_is_refused() {
    let _ = Tape::new().constant(Tensor::zeros([2, 0], DType::F32)).max(&[1]);
}

#[test]
fn operators_take_variables_by_value_and_by_reference() {
    let tape = Tape::new();
    let x = tape.leaf(Tensor::from_vec(vec![3.0f64], [1]));
    let y = -(2.0 * &x.clone() - x.clone() * 0.5) / (&x + 1.0) + x.clone() * &x - &x / x.clone();
    assert_eq!(y.item().unwrap(), -4.5 / 4.0 + 9.0 - 1.0);
}

/// Gradients of `x^y` in `x` and in `y`.
fn slopes_of_powf(x: f64, y: f64, dtype: DType) -> [f64; 2] {
    let tape = Tape::new();
    let [x, y] = [x, y].map(|value| tape.leaf(Tensor::full(value, [2], dtype)));
    let gradients = x.powf(&y).sum_all().backward().unwrap();
    [&x, &y].map(|leaf| gradients.wrt(leaf).unwrap().to_vec().unwrap()[1])
}

#[test]
fn powers_at_their_edges_have_the_slopes_of_pytorch() {
    let (infinite, nan) = (f64::INFINITY, f64::NAN);
    // base, exponent, slope in the base, slope in the exponent
    for (x, y, in_base, in_exponent) in [
        (0.0, 0.0, 0.0, 0.0),
        (0.0, -3.0, -infinite, -infinite),
        (0.0, 0.5, infinite, 0.0),
        (0.0, 1.0, 1.0, 0.0),
        (0.0, 2.5, 0.0, 0.0),
        (-2.0, 3.0, 12.0, nan),
        (-2.0, 0.0, 0.0, nan),
        (-2.0, 2.5, nan, nan),
        (2.0, 0.0, 0.0, std::f64::consts::LN_2),
        (nan, 0.0, 0.0, nan),
        (nan, 2.0, nan, nan),
        (1.0, 7.0, 7.0, 0.0),
    ] {
        for (dtype, tolerance) in [(DType::F64, 1e-15), (DType::F32, 1e-6)] {
            let found = slopes_of_powf(x, y, dtype);
            for (found, wanted) in found.into_iter().zip([in_base, in_exponent]) {
                let same = found == wanted || (found.is_nan() && wanted.is_nan());
                assert!(
                    same || (found - wanted).abs() <= tolerance * wanted.abs(),
                    "{x}^{y} in {dtype}: {found}, not {wanted}"
                );
            }
        }
    }
}

#[test]
fn other_functions_at_zero_have_the_slopes_of_pytorch() {
    let infinite = f64::INFINITY;
    let slope = |function: &dyn Fn(&Var) -> Var, x: f64| {
        let leaf = Tape::new().leaf(Tensor::full(x, [2], DType::F64));
        let gradients = function(&leaf).sum_all().backward().unwrap();
        gradients.wrt(&leaf).unwrap().slice::<f64>()[0]
    };
    assert_eq!(slope(&|x| x.pow(0.0), 0.0), 0.0);
    assert_eq!(slope(&|x| x.pow(-3.0), 0.0), -infinite);
    assert_eq!(slope(&|x| x.pow(-2.0), 2.0), -0.25);
    assert_eq!(slope(&|x| x.pow(0.5), 0.0), infinite);
    assert_eq!(slope(&|x| x.pow(2.4), 0.0), 0.0);
    assert_eq!(slope(&Var::sqrt, 0.0), infinite);
    assert_eq!(slope(&Var::rsqrt, 0.0), -infinite);
    assert_eq!(slope(&Var::recip, 0.0), -infinite);
    assert_eq!(slope(&Var::ln, 0.0), infinite);
    assert_eq!(slope(&Var::ln, -2.0), -0.5);
    assert_eq!(slope(&|x| 3.0 / x, 0.0), -infinite);
}
