//! Laws of one's own in scenes.

use std::path::Path;

use gradreel_models::scenes::{Runner, SceneFile, Setup};

/// Two bodies of one material: each has its own middle, around which its layers lie.
#[test]
fn what_varies_in_space_belongs_to_each_body() {
    let scene = "[time]\nduration_s = 0.1\n[grid]\nspacing_m = 0.1\n[ground]\n\
                 [materials.m]\nlaw = 'layers.wgsl'\ndensity_kg_m3 = 1e3\nlower = 2e4\nupper = 5e4\nbulk = 1e5\nfibres = 1e4\n\
                 [[objects]]\nmaterial = 'm'\nshape.box = { centre_m = [0.0, 0.5, 0.0], size_m = [0.2, 0.2, 0.2] }\n\
                 [[objects]]\nmaterial = 'm'\nshape.box = { centre_m = [1.0, 1.5, 0.0], size_m = [0.2, 0.2, 0.2] }\n";
    let setup = Setup::of(&SceneFile::parse(scene).unwrap(), Path::new("../examples/laws")).unwrap();
    let law = &setup.materials[0].law;
    for (p, x) in setup.positions.iter().enumerate() {
        let middle = [0.5, 1.5][setup.object_of[p] as usize];
        assert_eq!(law.history_at(p)[0], f64::from(u8::from(x[1] > middle)), "particle {p} at {x:?}");
    }
    let mut runner = Runner::<f64>::new(&setup).unwrap();
    assert!(runner.advance(|| true).unwrap());
}
