//! The networks on volumes, and the path from noised views to frustum volumes.

use crate::layers::{Init, Scope, TimeEmbedding, Weights};
use crate::views::{
    EncoderSizes, FrustumNet, FrustumSizes, Ring, SpatialNet, SpatialSizes, TargetEncoder, VolumePath, VolumeSizes,
};
use gradreel::{Result, Shape, Tape, Var};

use super::harness::{Case, Tolerance, check};
use super::procedural::{Source, input};

const SINGLE: Tolerance = Tolerance { value: 2e-5, gradient: 2e-4 };

#[test]
fn target_view_encoder() {
    check("target_view_encoder", "", SINGLE, |case| {
        let [width, inputs, ..] = case.shape("init_conv.weight")[..] else { panic!("a kernel") };
        let time = case.shape("out_conv0.time_embed.weight")[1];
        let view = case.shape("out_conv0.view_embed.weight")[1];
        let outputs = case.shape("final_out.2.bias")[0];
        let net = TargetEncoder::new(&case.scope(), EncoderSizes { inputs, width, outputs, time, view })?;
        Ok(vec![("out.y".into(), net.forward(&case.input("x"), &case.input("t"), &case.input("v")))])
    });
}

#[test]
fn spatial_net() {
    check("spatial_time_net", "", SINGLE, |case| {
        let inputs = case.shape("init_conv.weight")[1];
        let sizes = SpatialSizes { inputs, widths: case.sizes("dims"), time: case.size("time_dim") };
        let net = SpatialNet::new(&case.scope(), sizes)?;
        Ok(vec![("out.y".into(), net.forward(&case.input("x"), &case.input("t"))?)])
    });
}

#[test]
fn frustum_net() {
    check("frustum_net", "", SINGLE, |case| {
        let (time, view) = (case.size("time_dim"), case.size("view_dim"));
        let sizes = FrustumSizes { inputs: case.size("in_dim"), widths: case.sizes("dims"), time, view };
        let net = FrustumNet::new(&case.scope(), sizes)?;
        let pyramid = net.forward(&case.input("x"), &case.input("t"), &case.input("v"))?;
        Ok(pyramid.into_iter().map(|level| (format!("out.level_{}", level.dims()[4]), level)).collect())
    });
}

/// The sizes that a file tells, for latents of so many channels.
pub fn sizes(case: &Case<'_>, latent: usize) -> VolumeSizes {
    VolumeSizes {
        latent,
        features: case.size("enc"),
        time: case.size("time_dim"),
        spatial: case.sizes("sdims"),
        frustum: case.sizes("vdims"),
        voxels: case.size("V"),
        depth: case.size("D"),
        input: false,
    }
}

#[test]
fn from_noised_views_to_frustum_volumes() {
    check("volume_path", "", Tolerance { value: 5e-5, gradient: 1e-3 }, |case| {
        let sizes = sizes(case, case.dims("in.x_noisy")[2]);
        let time = TimeEmbedding::new(&case.scope().at("time_embed"), sizes.time, sizes.time)?;
        let path = VolumePath::new(&case.scope().at("spatial_volume"), sizes, Ring::published(case.size("views")))?;
        let noised = case.input("x_noisy");
        let time = time.forward(&noised, &case.numbers("t"))?;
        let viewpoints = path.viewpoints(&noised, &case.numbers("elevation"))?;
        let unprojected = path.unproject(&noised, &time, &viewpoints)?;
        let volume = path.spatial_volume(&unprojected, &time)?;
        let views: Vec<usize> = case.numbers("target_index").iter().map(|v| *v as usize).collect();
        let samples = path.frustum_samples(&volume, &views, noised.dims()[4])?;
        let times = time.broadcast_to([views.len(), time.dims()[1]]);
        let of_views: Vec<_> = views.iter().map(|&v| viewpoints.slice(1, v..v + 1)).collect();
        let told = of_views[0].concat(&of_views[1..].iter().collect::<Vec<_>>(), 1).reshape([views.len(), 4]);
        let pyramid = path.pyramid(&samples, &times, &told)?;
        let mut results = vec![
            ("out.t_embed".into(), time.clone()),
            ("out.v_embed".into(), viewpoints.clone()),
            ("out.spatial_volume".into(), volume),
            ("mid.frustum_sampled".into(), samples),
        ];
        results.extend(pyramid.into_iter().map(|level| (format!("out.frustum_{}", level.dims()[4]), level)));
        Ok(results)
    });
}

/// Told the same of it, an input image at the first camera's place is seen like the first of the noised views.
#[test]
fn an_input_image_is_unprojected_from_where_it_was_taken() {
    struct Alike(Source);
    impl Weights for Alike {
        fn weight(&self, path: &str, shape: &Shape, init: Init) -> Result<Var> {
            self.0.weight(&path.replace("input_encoder", "target_encoder"), shape, init)
        }
    }
    let ring = Ring::published(4);
    let (latent, voxels, width) = (4, 6, 8);
    let sizes =
        VolumeSizes { latent, features: 3, time: 16, spatial: [8; 4], frustum: [8; 4], voxels, depth: 8, input: true };
    let tape = Tape::new();
    let given = |name: &str, shape: &[usize]| tape.constant(input("input view", name, shape));
    let weights = Alike(Source { seed: "input view", tape: tape.clone() });
    let path = VolumePath::new(&Scope::root(&weights), sizes, ring.clone()).unwrap();
    let (noised, time) = (given("views", &[2, 4, latent, width, width]), given("time", &[2, 16]));
    let elevations = [ring.elevation, ring.elevation - 0.4];
    let viewpoints = path.viewpoints(&noised, &[ring.elevation; 2]).unwrap();
    let all = path.unproject(&noised, &time, &viewpoints).unwrap();
    let first = noised.slice(1, 0..1).reshape([2, latent, width, width]);
    let seen = path.unproject_input(&first, &time, &elevations).unwrap().expect("it has an encoder for it");
    let off = |sample: usize| {
        let [a, b] = [&all.slice(1, 0..3), &seen].map(|x| x.slice(0, sample..sample + 1));
        (&a - &b).square().mean_all().item().unwrap().sqrt()
    };
    assert!(off(0) < 1e-5, "the same place: {}", off(0));
    assert!(off(1) > 0.1, "another camera sees the voxels elsewhere: {}", off(1));
}
