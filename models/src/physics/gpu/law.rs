//! A material as two kernels: its program and the adjoint program, with loads and stores of a particle.

use std::fmt::Write;

use gradreel::backend::gpu::Kernel;
use gradreel::scalar::Program;

use super::kernels::{MATERIAL, MATERIAL_VJP};
use crate::physics::law::Law;

/// Accessors of a state and of the values of a material, shared or per particle.
const READ: &str = "
fn entry(component: u32, p: u32) -> f32 {
    return now[place(component, p)];
}

// Value k of particle i of the material: mass, then parameters. The list begins with offset and step of each.
fn value(k: u32, i: u32) -> f32 {
    return bitcast<f32>(values[values[2u * k] + values[2u * k + 1u] * i]);
}
";

/// The kernels of a material.
#[derive(Debug)]
pub(crate) struct LawKernels {
    /// From a state to the records of particles, the new deformation gradients and history.
    pub forward: Kernel,
    /// Its adjoint.
    pub reverse: Kernel,
}

impl LawKernels {
    /// Generates the kernels of a law.
    pub fn of(law: &Law) -> Self {
        let around = |program: &Program, rest: String, (text, buffers): (&'static str, _)| {
            Kernel::around(format!("{}{READ}{rest}", program.wgsl()), program.name().to_owned(), text, buffers)
        };
        let forward = around(law.forward(), forward(law), MATERIAL);
        let reverse = around(law.reverse(), reverse(law), MATERIAL_VJP);
        Self { forward, reverse }
    }
}

/// The inputs of a law: deformation gradient, affine velocity, substep, stress scale, mass, parameters, history.
fn arguments(law: &Law) -> Vec<String> {
    let entry = |part: &'static str, k: usize| format!("entry({part} + {k}u, p)");
    let fixed = ["substep.dt", "substep.stress_scale", "value(0u, i)"].map(str::to_owned);
    (0..9)
        .map(|k| entry("F", k))
        .chain((0..9).map(|k| entry("C", k)))
        .chain(fixed)
        .chain((0..law.parameters().len()).map(|k| format!("value({}u, i)", k + 1)))
        .chain((0..law.history().len()).map(|k| entry("F + 9u", k)))
        .collect()
}

/// `respond(p, i)`: stores deformation gradient and history, returns the columns of the affine matrix.
fn forward(law: &Law) -> String {
    let program = law.forward();
    let members = program.wgsl_members();
    let (name, arguments) = (program.wgsl_name(), arguments(law).join(", "));
    let mut text = String::from("\nfn respond(p: u32, i: u32) -> array<vec3<f32>, 3> {\n");
    write(&mut text, format_args!("    let r = {name}({arguments});\n"));
    for (k, member) in members[..9].iter().chain(&members[18..]).enumerate() {
        write(&mut text, format_args!("    next[place(F + {k}u, p)] = r.{member};\n"));
    }
    let entry = |row: usize, column: usize| format!("r.{}", members[9 + 3 * row + column]);
    let columns: Vec<String> =
        (0..3).map(|j| format!("vec3<f32>({}, {}, {})", entry(0, j), entry(1, j), entry(2, j))).collect();
    write(&mut text, format_args!("    return array<vec3<f32>, 3>({});\n}}\n", columns.join(", ")));
    text
}

/// `pull_back(p, i)`: replaces cotangents of the state, adds to those of mass and parameters.
fn reverse(law: &Law) -> String {
    let program = law.reverse();
    let members = program.wgsl_members();
    let (parameters, history) = (law.parameters().len(), law.history().len());
    let cotangents = (0..9)
        .map(|k| format!("cotangent[place(F + {k}u, p)]"))
        .chain((0..9).map(|k| format!("on_record[place({k}u, p)]")))
        .chain((0..history).map(|k| format!("cotangent[place(F + {}u, p)]", 9 + k)));
    let arguments: Vec<String> = arguments(law).into_iter().chain(cotangents).collect();
    let mut text = String::from("\nfn pull_back(p: u32, i: u32) {\n");
    write(&mut text, format_args!("    let r = {}({});\n", program.wgsl_name(), arguments.join(", ")));
    let state = (0..9).map(|k| format!("F + {k}u")).chain((0..9).map(|k| format!("C + {k}u")));
    let kept = (0..history).map(|k| format!("F + {}u", 9 + k));
    let names = members[..18].iter().chain(&members[19 + parameters..]);
    for (place, member) in state.chain(kept).zip(names) {
        write(&mut text, format_args!("    cotangent[place({place}, p)] = r.{member};\n"));
    }
    write(&mut text, format_args!("    on_values[i] += on_record[place(9u, p)] + r.{};\n", members[18]));
    for (k, member) in members[19..19 + parameters].iter().enumerate() {
        write(&mut text, format_args!("    on_values[{}u * substep.count + i] += r.{member};\n", k + 1));
    }
    text + "}\n"
}

fn write(text: &mut String, line: std::fmt::Arguments<'_>) {
    text.write_fmt(line).expect("writing to a string succeeds");
}
