//! Single layers.

use crate::layers::{
    DepthAttention, DepthAttentionSizes, Downsample, ResidualBlock, SpatialTransformer, TimeEmbedding,
    TransformerSizes, Upsample,
};
use gradreel::Tensor;

use super::harness::{Case, Tolerance, check, close, load, places};

const SINGLE: Tolerance = Tolerance { value: 2e-5, gradient: 2e-4 };

fn residual(name: &str) {
    check(name, "", SINGLE, |case| {
        let [outputs, inputs, ..] = case.shape("in_layers.2.weight")[..] else { panic!("a kernel") };
        let embedding = case.shape("emb_layers.1.weight")[1];
        let block = ResidualBlock::new(&case.scope(), inputs, outputs, embedding)?;
        Ok(vec![("out.y".into(), block.forward(&case.input("x"), &case.input("emb")))])
    });
}

#[test]
fn residual_block() {
    residual("resblock_same");
}

#[test]
fn residual_block_that_changes_its_width() {
    residual("resblock_change");
}

#[test]
fn spatial_transformer() {
    check("spatial_transformer", "", SINGLE, |case| {
        let channels = case.shape("norm.weight")[0];
        let context = case.shape("transformer_blocks.0.attn2.to_k.weight")[1];
        let sizes = TransformerSizes { channels, heads: case.size("heads"), context };
        let layer = SpatialTransformer::new(&case.scope(), sizes)?;
        Ok(vec![("out.y".into(), layer.forward(&case.input("x"), &case.input("context")))])
    });
}

#[test]
fn depth_attention() {
    check("depth_transformer", "", SINGLE, |case| {
        let [_, channels, ..] = case.shape("proj_in.0.weight")[..] else { panic!("a kernel") };
        let context = case.shape("proj_context.1.weight")[0];
        let sizes = DepthAttentionSizes { channels, head: case.size("head_dim"), context };
        let layer = DepthAttention::new(&case.scope(), sizes)?;
        Ok(vec![("out.y".into(), layer.forward(&case.input("x"), Some(&case.input("context"))))])
    });
}

#[test]
fn downsample() {
    check("downsample", "", SINGLE, |case| {
        let layer = Downsample::new(&case.scope(), case.shape("op.bias")[0])?;
        Ok(vec![("out.y".into(), layer.forward(&case.input("x")))])
    });
}

#[test]
fn upsample() {
    check("upsample", "", SINGLE, |case| {
        let layer = Upsample::new(&case.scope(), case.shape("conv.bias")[0])?;
        Ok(vec![("out.y".into(), layer.forward(&case.input("x")))])
    });
}

#[test]
fn time_embeddings() {
    let file = load("time_embeddings");
    for place in places() {
        let case = Case::new(&file, &place);
        let times = case.numbers("t");
        for (name, expected) in file.tensors.iter().filter(|(name, _)| name.starts_with("out.sinusoid_")) {
            // the largest number is 1; single-precision products of large times are off by up to 7e-5
            let of = case.tape.constant(Tensor::from_vec(times.clone(), [times.len()]));
            close(name, of.sinusoid(expected.dims()[1]).value().unwrap(), expected, 1e-4);
        }
        for prefix in ["volume", "unet"] {
            let [outputs, features] = case.shape(&format!("{prefix}_time_embed.0.weight"))[..] else {
                panic!("a matrix")
            };
            let scope = case.scope().at(format_args!("{prefix}_time_embed"));
            let layer = TimeEmbedding::new(&scope, features, outputs).unwrap();
            let like = case.input("t");
            let found = layer.forward(&like, &times).unwrap();
            let name = format!("out.{prefix}_time_embed");
            close(&name, found.value().unwrap(), file.get(&name).unwrap(), 2e-4);
        }
    }
}
