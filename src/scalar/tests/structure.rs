//! What tracing keeps: sharing, constants, dead code, names, and misuse.

use super::super::{Mat3, Program, Scalar};

fn length(f: impl FnOnce(Scalar, Scalar) -> Scalar) -> usize {
    Program::trace("f", &["x", "y"], &["z"], |v| vec![f(v[0], v[1])]).len()
}

#[test]
fn equal_subexpressions_are_stored_once() {
    assert_eq!(length(|x, y| (x * y).exp() + (y * x).exp().sin()), 4);
    assert_eq!(length(|x, y| (x + y) * (y + x)), 2);
    // det F, its cofactors and F⁻¹ share nine of the eighteen products of each minor.
    let inverse =
        |names: &[&str]| Program::trace("inverse", names, names, |f| Mat3::from_slice(f).inverse().to_vec()).len();
    // 18 products and 9 differences of minors, 3 products and 2 sums of the determinant, 1 reciprocal, 9 products.
    assert_eq!(inverse(&["a", "b", "c", "d", "e", "f", "g", "h", "i"]), 18 + 9 + 5 + 1 + 9);
}

#[test]
fn neutral_elements_and_constants_vanish() {
    assert_eq!(length(|x, _| 1.0 * (x + 0.0) - 0.0), 0);
    assert_eq!(length(|x, y| x * 0.0 + y), 0);
    assert_eq!(length(|x, _| -(-x)), 0);
    assert_eq!(length(|x, y| x - (-y)), 1);
    assert_eq!(length(|x, y| (-x) * (-y)), 1);
    assert_eq!(length(|x, _| x + (Scalar::from(2.0).ln() * 3.0 - 1.0)), 1);
    assert_eq!(length(|x, y| x.lt(y).select(x, x)), 0);
    assert_eq!(length(|x, _| x.powi(8)), 3);
    assert_eq!(length(|x, _| x.powf(1.0)), 0);
}

#[test]
fn dead_code_is_dropped() {
    let unused = length(|x, y| {
        let _ = x.exp().sin();
        x + y
    });
    assert_eq!(unused, 1);
}

#[test]
fn differences_of_equal_terms_keep_a_nan_visible() {
    let program = Program::trace("f", &["x"], &["y"], |x| vec![x[0] - x[0]]);
    assert!(program.eval(&[f32::INFINITY])[0].is_nan());
}

#[test]
fn the_listing_of_a_derivative_is_readable() {
    let program = Program::trace("potential", &["x", "k"], &["e"], |v| vec![0.5 * v[1] * v[0].square() + v[0].abs()]);
    let listing = "\
potential_vjp(x, k, g_e) -> g_x, g_k
  %0 = input x
  %1 = input k
  %2 = input g_e
  %3 = const 0.5
  %4 = mul %1 %3
  %5 = mul %0 %0
  %6 = sign %0
  %7 = mul %2 %6
  %8 = mul %2 %5
  %9 = mul %2 %4
  %10 = const 2
  %11 = mul %9 %10
  %12 = mul %0 %11
  %13 = add %7 %12
  %14 = mul %3 %8
  g_x = %13
  g_k = %14
";
    assert_eq!(program.vjp().to_string(), listing);
}

#[test]
fn a_program_can_be_used_inside_another() {
    let square = Program::trace("square", &["x"], &["y"], |x| vec![x[0].square()]);
    let nested = Program::trace("f", &["x"], &["y"], |x| {
        let inner = Program::trace("inner", &["a"], &["b"], |a| vec![a[0] + 1.0]);
        square.apply(&inner.apply(x))
    });
    assert_eq!(nested.eval(&[2.0_f64]), [9.0]);
    assert_eq!(nested.len(), 2);
}

#[test]
fn dependence_is_known() {
    let program = Program::trace("f", &["x", "y"], &["a", "b"], |v| vec![v[0].exp(), v[0] * v[1]]);
    let depends = |output, input| program.depends(output, input);
    assert_eq!([depends(0, 0), depends(0, 1), depends(1, 0), depends(1, 1)], [true, false, true, true]);
}

#[test]
fn constants_compute_outside_a_trace() {
    let x = Scalar::from(2.0);
    assert_eq!((x.powi(3) - 1.0).sqrt().constant(), Some(7.0_f64.sqrt()));
    assert_eq!(x.lt(3.0).select(1.0, 2.0).constant(), Some(1.0));
}

#[test]
fn names_of_derivatives_stay_unique() {
    let program = Program::trace("f", &["x", "g_y"], &["y"], |v| vec![v[0] * v[1]]);
    assert_eq!(program.vjp().inputs(), ["x", "g_y", "g_y_"]);
}

#[test]
#[should_panic(expected = "the traced function returned 1 values, 2 outputs are named")]
fn a_wrong_number_of_outputs_is_refused() {
    let _ = Program::trace("f", &["x"], &["y", "z"], |x| vec![x[0]]);
}

#[test]
#[should_panic(expected = "outside Program::trace")]
fn a_handle_that_escaped_is_refused() {
    let mut escaped = None;
    let _ = Program::trace("f", &["x"], &["y"], |x| {
        escaped = Some(x[0]);
        vec![x[0]]
    });
    let _ = escaped.expect("the trace ran") + 1.0;
}

#[test]
#[should_panic(expected = "a value of another trace")]
fn a_handle_of_another_trace_is_refused() {
    let _ = Program::trace("outer", &["x"], &["y"], |x| {
        let inner = Program::trace("inner", &["a"], &["b"], |a| vec![a[0] + x[0]]);
        inner.apply(x)
    });
}

#[test]
#[should_panic(expected = "is not a name")]
fn a_name_with_a_space_is_refused() {
    let _ = Program::trace("f", &["yield stress"], &["y"], |x| vec![x[0]]);
}

#[test]
fn a_panic_inside_a_trace_leaves_no_trace_open() {
    let failed = std::panic::catch_unwind(|| Program::trace("f", &["x"], &["y"], |_| panic!("on purpose")));
    assert!(failed.is_err());
    assert_eq!(Program::trace("f", &["x"], &["y"], |x| vec![x[0] + 1.0]).eval(&[1.0_f32]), [2.0]);
}
