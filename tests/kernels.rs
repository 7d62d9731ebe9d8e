//! Every kernel is valid WGSL within WebGPU's guaranteed limits and binds what the host gives. Needs no GPU.

use std::collections::BTreeSet;
use std::path::Path;

use gradreel::backend::gpu::Kernel;
use gradreel::ops::{Map, kernels};
use gradreel::scalar::{Program, Scalar};
use gradreel::{DType, ErrorKind};

/// A sum of `count` operands.
fn sum_of(count: usize) -> Map {
    let names: Vec<String> = (0..count).map(|n| format!("x{n}")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    Map::new(Program::trace("total", &names, &["y"], |x| vec![x.iter().copied().reduce(|a, b| a + b).unwrap()]))
}

fn check(kernel: &Kernel) {
    let module = kernel.reflect().unwrap_or_else(|error| panic!("{error}"));
    let [result, operands @ ..] = module.buffers() else { panic!("{} binds nothing", kernel.name()) };
    assert!(result.written, "{}: the first buffer is the result", kernel.name());
    assert!(operands.iter().all(|x| !x.written), "{}: operands are read only", kernel.name());
    assert!(module.buffers().len() <= 8 && module.invocations() <= 256, "{}", kernel.name());
    assert!(module.parameters().is_some_and(|(_, bytes)| bytes % 4 == 0), "{}: no parameters", kernel.name());
}

#[test]
fn every_kernel_file_is_listed_and_valid() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("kernels");
    let files: BTreeSet<String> = folder
        .read_dir()
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "wgsl"))
        .map(|path| path.file_stem().unwrap().to_str().unwrap().to_owned())
        .collect();
    let mut listed: BTreeSet<String> = kernels().iter().map(|kernel| kernel.name().to_owned()).collect();
    listed.insert("map".to_owned());
    assert_eq!(files, listed);
    kernels().into_iter().for_each(check);
}

#[test]
fn maps_of_up_to_seven_operands_are_valid() {
    for count in 1..=7 {
        let map = sum_of(count);
        let kernel = map.kernel().unwrap();
        check(kernel);
        let module = kernel.reflect().unwrap();
        assert_eq!(module.buffers().len(), count + 1);
        assert!(module.buffers().iter().all(|buffer| buffer.element == DType::F32));
    }
    let error = sum_of(8).kernel().err().unwrap();
    assert_eq!(error.kind(), ErrorKind::Unsupported);
    assert!(error.to_string().contains("total") && error.to_string().contains("at most 7"), "{error}");
}

#[test]
fn names_of_a_program_cannot_hide_those_of_its_kernel() {
    for name in ["main", "value", "place", "sizes", "linear_group", "WORKGROUP", "y", "program"] {
        let map = Map::new(Program::trace(name, &["y", "sizes"], &["main"], |x: &[Scalar]| vec![x[0] * x[1]]));
        check(map.kernel().unwrap());
    }
}

#[test]
fn a_fault_is_named_with_file_and_line() {
    let cases: [(&'static str, &'static [&'static str], &str); 5] = [
        ("#import \"shared/linear.wgsl\"\nfn f( {}\n", &[], "broken.wgsl:2"),
        ("#import \"shared/nothing.wgsl\"\n", &[], "broken.wgsl:1"),
        ("fn f() -> u32 {\n    return 1.5;\n}\n", &[], "broken.wgsl:"),
        ("@compute @workgroup_size(1) fn main() {}", &["y"], "no storage buffer y"),
        (
            "@group(0) @binding(0) var<storage, read_write> z: array<f32>;
             @compute @workgroup_size(1) fn main() { z[0] = 1.0; }",
            &[],
            "gives no storage buffer z",
        ),
    ];
    for (text, buffers, expected) in cases {
        let error = Kernel::new("broken", "main", text, buffers).reflect().unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Input);
        assert!(error.to_string().contains(expected), "{expected} is not in: {error}");
    }
}
