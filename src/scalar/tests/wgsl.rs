//! Emitted WGSL parses and validates.

use super::super::{Mat3, Program, wgsl_module};
use super::{every_instruction, everything};

#[track_caller]
fn validate(source: &str) -> naga::Module {
    let module =
        naga::front::wgsl::parse_str(source).unwrap_or_else(|e| panic!("{}\n{source}", e.emit_to_string(source)));
    let flags = naga::valid::ValidationFlags::all();
    naga::valid::Validator::new(flags, naga::valid::Capabilities::default())
        .validate(&module)
        .unwrap_or_else(|e| panic!("{}\n{source}", e.emit_to_string(source)));
    module
}

#[test]
fn every_instruction_and_its_derivatives_validate() {
    for program in every_instruction() {
        for program in [program.vjp(), program.jvp(), program] {
            validate(&program.wgsl());
        }
    }
}

#[test]
fn long_programs_validate_and_keep_their_signature() {
    let program = everything();
    let module = validate(&program.wgsl());
    let (_, function) =
        module.functions.iter().find(|(_, f)| f.name.as_deref() == Some("everything")).expect("it is there");
    assert_eq!(function.arguments.len(), 3);
    validate(&program.vjp().wgsl());
}

#[test]
fn constants_that_wgsl_cannot_write_validate() {
    let program = Program::trace("odd", &["x"], &["a", "b", "c", "d", "e", "f"], |x| {
        let x = x[0];
        let tiny = x * 1e-42;
        vec![x.min(f64::INFINITY), x + f64::NEG_INFINITY, x * f64::NAN, x - -2.5, x * 1e300 + tiny, x * 1e25]
    });
    validate(&program.wgsl());
    let unfolded = Program::trace("pole", &["x"], &["y"], |x| vec![x[0] + (x[0] * 0.0).recip()]);
    validate(&unfolded.wgsl());
}

#[test]
fn names_that_wgsl_keeps_for_itself_are_changed() {
    let program = Program::trace("exp", &["var", "select"], &["ref", "exp"], |x| vec![x[0].exp(), x[1] + x[0]]);
    validate(&program.wgsl());
    assert_eq!(program.wgsl_name(), "exp_");
    assert_eq!(program.wgsl_members(), ["ref_", "exp"]);
    let listed = Program::trace("loop", &["x"], &["y"], |x| vec![x[0].tanh()]);
    assert_eq!(listed.wgsl_name(), "loop_");
    validate(&listed.wgsl());
}

#[test]
fn a_module_of_several_programs_brings_each_function_once() {
    let program = everything();
    let text = wgsl_module(&[&program, &program.vjp(), &program.jvp()]);
    validate(&text);
    assert_eq!(text.matches("fn scalar_ln(").count(), 1);
}

#[test]
fn literal_nans_never_occur() {
    let program = Program::trace("f", &["x"], &["y"], |x| vec![x[0] * f64::NAN]);
    assert!(program.wgsl().contains("bitcast<f32>(infinite | 0x400000u)"), "{}", program.wgsl());
}

#[test]
fn decompositions_and_isotropic_functions_validate() {
    let names = ["a", "b", "c", "d", "e", "f", "g", "h", "i"];
    let program = Program::trace("hencky", &names, &["u", "v", "t"], |x| {
        let principal = Mat3::from_slice(x).principal();
        let stress = principal.left(principal.stretches().map(|s| s.ln()));
        vec![principal.u().0[0][1], principal.v().0[2][0], stress.trace() + stress.0[0][1]]
    });
    let text = wgsl_module(&[&program, &program.vjp(), &program.jvp()]);
    validate(&text);
    assert_eq!(text.matches("fn scalar_svd(").count(), 1);
}
