//! `gradreel weights`: what a file of weights is told to hold, and its copies in other types.

use std::path::PathBuf;

use gradreel::io::{Archive, Stored};

use crate::scene::{Scene, text};

fn small(name: &str) -> String {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/vectors");
    folder.join(name).display().to_string()
}

#[test]
fn every_difference_from_the_model_is_listed() {
    let scene = Scene::new();
    for name in ["tiny_lightning.ckpt", "tiny_legacy_format.ckpt", "tiny_checkpoint_expected.safetensors"] {
        let check = format!("weights check {} --quiet", small(name));
        scene.refuses(&check, &[name, "1602 weights", "missing", "1 of another shape"]);
        let printed = text(&scene.run(&check).stdout);
        for part in [
            "15 tensors",
            "0 of 1602 weights fit",
            "1601 missing:",
            "    first_stage_model.quant_conv.bias\n",
            "14 unexpected:",
            "    a.strided_view\n",
            "    model.diffusion_model.input_blocks.0.0.weight: [4, 8, 3, 3], not [320, 8, 3, 3]\n",
        ] {
            assert!(printed.contains(part), "{name}: no {part:?} in: {printed}");
        }
        let listed = text(&scene.run(&format!("{check} --list --numbers")).stdout);
        for part in ["    bf16 bf16 [4]\n", "    double f64 [2, 2]\n", "    empty f32 [0, 3]\n", "    bool bool [3]\n"]
        {
            assert!(listed.contains(part), "{name}: no {part:?} in: {listed}");
        }
    }
    let forbidden = small("tiny_forbidden_call.ckpt");
    scene.refuses(&format!("weights check {forbidden}"), &["tiny_forbidden_call.ckpt", "1602 missing"]);
    let listed = text(&scene.run(&format!("weights check {forbidden} --list")).stdout);
    assert!(listed.contains("    bad: ") && listed.contains("    w f32"), "{listed}");
    scene.write("noise.ckpt", [7; 100]);
    scene.refuses("weights check noise.ckpt", &["noise.ckpt"]);
    scene.refuses("weights check nowhere.ckpt", &["nowhere.ckpt"]);
}

#[test]
fn a_file_that_states_its_sizes_is_compared_with_these() {
    let scene = Scene::new();
    let mut file = crate::model::weights();
    let count = file.tensors.len();
    file.write(scene.path("model.safetensors")).unwrap();
    let printed = scene.succeeds("weights check model.safetensors --numbers");
    assert!(printed.contains(&format!("{count} of {count} weights fit, 0 more")), "{printed}");
    assert!(printed.contains("all numbers are finite"), "{printed}");
    scene.succeeds("weights convert model.safetensors half.safetensors --f16");
    let printed = scene.succeeds("weights check half.safetensors");
    assert!(printed.contains(&format!("{count} tensors ({count} f16)")), "{printed}");
    file.tensors.remove("cc_projection.bias");
    file.write(scene.path("model.safetensors")).unwrap();
    scene.refuses("weights check model.safetensors", &["1 missing"]);
}

#[test]
fn numbers_that_are_none_are_named() {
    let scene = Scene::new();
    let mut file = gradreel::io::TensorFile::default();
    for (name, value) in [("good", 1.0f32), ("broken", f32::NAN), ("endless", f32::INFINITY)] {
        file.tensors.insert(name.into(), gradreel::Tensor::from_vec(vec![0.0, value], [2]));
    }
    file.write(scene.path("some.safetensors")).unwrap();
    scene.refuses("weights check some.safetensors --numbers", &["2 with NaN or infinity"]);
    let printed = text(&scene.run("weights check some.safetensors --numbers").stdout);
    assert!(printed.contains("2 with NaN or infinity:\n    broken\n    endless\n"), "{printed}");
}

#[test]
fn a_copy_has_the_same_tensors_in_the_type_asked_for() {
    let scene = Scene::new();
    let expected = Archive::open(small("tiny_checkpoint_expected.safetensors")).unwrap();
    for name in ["tiny_lightning.ckpt", "tiny_legacy_format.ckpt"] {
        for (option, floats) in
            [("", None), ("--f16", Some(Stored::F16)), ("--f32", Some(Stored::F32)), ("--bf16", Some(Stored::Bf16))]
        {
            let to = format!("{name}{option}.safetensors");
            let printed = scene.succeeds(&format!("weights convert {} {to} {option}", small(name)));
            assert!(printed.contains(name) && printed.contains(&to) && printed.contains("15 tensors"), "{printed}");
            let copy = Archive::open(scene.path(&to)).unwrap();
            assert!(copy.names().eq(expected.names()));
            for key in expected.names() {
                let (found, before) = (copy.entry(key).unwrap(), expected.entry(key).unwrap());
                let wanted = floats.filter(|_| before.stored.is_float()).unwrap_or(before.stored);
                assert_eq!((found.stored, &found.shape), (wanted, &before.shape), "{key}");
                let digits = match wanted {
                    Stored::F16 => 1e-3,
                    Stored::Bf16 => 8e-3,
                    Stored::F32 => 1e-7,
                    _ => 0.0,
                };
                let [a, b] = [&copy, &expected].map(|archive| archive.load(key).unwrap().to_vec().unwrap());
                let close = |(a, b): (&f64, &f64)| (a - b).abs() <= digits * b.abs() + digits * 1e-4;
                assert!(a.iter().zip(&b).all(close), "{key}: {a:?} for {b:?}");
            }
        }
    }
}

#[test]
fn what_cannot_be_converted_is_refused_and_leaves_nothing() {
    let scene = Scene::new();
    let from = small("tiny_lightning.ckpt");
    scene.refuses(&format!("weights convert {from} out.ckpt"), &["out.ckpt", "out.safetensors"]);
    scene.refuses("weights convert nowhere.ckpt out.safetensors", &["nowhere.ckpt"]);
    let forbidden = small("tiny_forbidden_call.ckpt");
    scene.refuses(&format!("weights convert {forbidden} out.safetensors --quiet"), &["bad"]);
    scene.write("there.safetensors", "something");
    scene.refuses(&format!("weights convert {from} there.safetensors"), &["there.safetensors", "--force"]);
    scene.succeeds(&format!("weights convert {from} there.safetensors --force"));
    // onto itself
    scene.succeeds("weights convert there.safetensors there.safetensors --force --f16");
    assert_eq!(Archive::open(scene.path("there.safetensors")).unwrap().entry("double").unwrap().stored, Stored::F16);
    let both = scene.run(&format!("weights convert {from} both.safetensors --f16 --f32"));
    assert!(both.status.code() == Some(2) && text(&both.stderr).contains("--f32"), "{}", text(&both.stderr));
}

#[test]
fn what_is_no_file_of_weights_is_named() {
    let scene = Scene::new();
    std::fs::create_dir(scene.path("folder")).unwrap();
    scene.write("ball.jpg", include_bytes!("ball.jpg"));
    scene.write("lfs.safetensors", "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n");
    scene.write("page.ckpt", "<!DOCTYPE html><html><head><title>Sign in</title></head></html>");
    scene.write("error.pt", "{\"error\": \"Repository not found\"}");
    scene.write("empty.pt", "");
    let mut cases = vec![
        ("folder", "a folder", "a file in it"),
        ("lfs.safetensors", "a Git LFS pointer, the text that stands for a file of 12345 bytes", "git lfs pull"),
        ("page.ckpt", "a web page, \"Sign in\"", "download the file again"),
        ("error.pt", "JSON text", "download the file again"),
        ("empty.pt", "an empty file", "again"),
    ];
    if cfg!(unix) {
        cases.push(("/dev/zero", "a device", "save the data as a file"));
    }
    for (path, found, fix) in cases {
        scene.refuses(&format!("weights check {path}"), &[path, found, fix]);
        scene.refuses(&format!("weights convert {path} out.safetensors"), &[path, found, fix]);
        // where weights are used
        scene.refuses(&format!("synthesize ball.jpg --elevation 0 --weights {path} --out run"), &[path, found]);
    }
}

#[test]
fn a_key_that_stands_twice_is_refused() {
    let scene = Scene::new();
    let header = r#"{"w":{"dtype":"F32","shape":[2],"data_offsets":[0,8]},"w":{"dtype":"F32","shape":[1,2],"data_offsets":[0,8]}}"#;
    let file = [&(header.len() as u64).to_le_bytes()[..], header.as_bytes(), &[0; 8]].concat();
    scene.write("twice.safetensors", file);
    scene.refuses("weights check twice.safetensors", &["\"w\" stands twice"]);
    scene.refuses("weights convert twice.safetensors out.safetensors", &["\"w\" stands twice"]);
}
