//! How the parts are used, and what comes of it.

#[test]
fn a_segment_that_is_recomputed_has_the_same_gradients() -> gradreel::Result<()> {
    use crate::layers::{Linear, Scope, Segment, initialise};
    use gradreel::{DType, Key, Tape, Tensor};

    let params = initialise(Key::new(1), DType::F64, |scope| Linear::new(scope, 3, 2))?;
    let gradient = |recomputed: bool| {
        let tape = Tape::new();
        let bound = params.bind(&tape);
        let scope = Scope::root(&bound);
        let scope = if recomputed { scope.recomputed() } else { scope };
        let part = Segment::new(&scope, |scope| Linear::new(scope, 3, 2))?;
        let x = tape.constant(Tensor::full(0.5, [4, 3], DType::F64));
        let y = part.run(&[&x], |linear, inputs| linear.forward(&inputs[0]).silu())?;
        bound.gradients(&y.sum_all().backward()?)
    };
    assert_eq!(gradient(false)?["weight"].slice::<f64>(), gradient(true)?["weight"].slice::<f64>());
    Ok(())
}

#[test]
fn weights_are_named_by_their_scope() -> gradreel::Result<()> {
    use crate::layers::{Linear, Scope, initialise};
    use gradreel::{DType, Key, Tape, Tensor};

    let build = |scope: &Scope<'_>| Linear::new(&scope.at("head"), 3, 2);
    let params = initialise(Key::new(1), DType::F32, build)?;
    assert_eq!(params.get("head.weight")?.dims(), &[2, 3]);

    let tape = Tape::new();
    let bound = params.bind(&tape);
    let head = build(&Scope::root(&bound))?;
    let y = head.forward(&tape.constant(Tensor::zeros([5, 3], DType::F32)));
    assert_eq!(y.dims(), &[5, 2]);
    Ok(())
}

#[test]
fn weights_of_a_file_are_found_by_name_and_what_is_wrong_is_counted() -> gradreel::Result<()> {
    use crate::layers::{Linear, Scope};
    use crate::views::FileWeights;
    use gradreel::io::TensorFile;
    use gradreel::{Device, Shape, Tape, Tensor};

    let path = super::harness::scratch("examples").join("weights.safetensors");
    let mut file = TensorFile::default();
    file.tensors.insert("head.weight".into(), Tensor::from_vec(vec![1.0f32, 2.0], [1, 2]));
    file.tensors.insert("head.bias".into(), Tensor::from_vec(vec![0.5f32], [1]));
    file.write(&path)?;

    let weights = FileWeights::open(&path, &Device::Cpu)?;
    let head = Linear::new(&Scope::root(&weights).at("head"), 2, 1)?;
    let tape = Tape::new();
    let x = tape.constant(Tensor::from_vec(vec![3.0f32, 4.0], [1, 2]));
    assert_eq!(head.forward(&x).item()?, 11.5);

    let wanted = [("head.weight".to_string(), Shape::from([2, 2])), ("head.scale".to_string(), Shape::from([1]))];
    let report = weights.check(&wanted);
    assert_eq!((report.missing.len(), report.unexpected.len(), report.misshaped.len()), (1, 1, 1));
    Ok(())
}

#[test]
fn a_box_ends_after_its_last_pixel() {
    use crate::views::ImageBox;

    // the third and fourth pixel of the second row of four
    let coverage = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let found = ImageBox::of_coverage(&coverage, 4).unwrap();
    assert_eq!((found.low, found.high), ([0.5, 0.25], [1.0, 0.5]));
}

#[test]
fn a_depth_covers_less_than_a_direction() {
    use crate::views::{Detection, ImageBox, Ring};

    let (ring, bounds) = (Ring::published(16), ImageBox { low: [0.4; 2], high: [0.6; 2] });
    let covered = |depth| {
        let found = ring.covered(16, 0.5, &Detection { bounds, depth });
        found.into_iter().filter(|inside| *inside).count()
    };
    assert!(covered(Some(1.5)) > 0 && covered(Some(1.5)) < covered(None));
}

#[test]
fn a_drawn_object_is_in_the_image() {
    use crate::views::Ring;
    use crate::views::objects::{Sample, SampleSettings};
    use gradreel::Key;

    let ring = Ring::published(16);
    let sample = Sample::draw(Key::new(7), &ring, 32, &SampleSettings::default());
    assert_eq!(sample.views.len(), 16);
    let seen = sample.seen(&ring).expect("the object is in the image");
    assert!(seen.bounds.low.iter().all(|x| *x > 0.0) && seen.bounds.high.iter().all(|x| *x < 1.0));
    assert!(seen.depth.is_some_and(|depth| (0.6..2.4).contains(&depth)));
}

#[test]
fn a_run_goes_on_from_its_file_to_the_same_end() -> gradreel::Result<()> {
    use crate::views::{Moment, Predictor, SamplerSettings, Sampling, Subject};
    use gradreel::{DType, Result, Tensor};

    /// A model that takes all it sees for noise.
    struct Doubter;
    impl Predictor for Doubter {
        fn predict(
            &self,
            moment: &Moment<'_>,
            views: &[usize],
            found: &mut dyn FnMut(usize, Tensor) -> Result<()>,
        ) -> Result<()> {
            let all = moment.latents.slice::<f32>();
            let size = all.len() / moment.latents.dims()[1];
            views.iter().try_for_each(|&v| found(v, Tensor::from_vec(all[v * size..][..size].to_vec(), [1, 4, 2, 2])))
        }
    }

    let latent = Tensor::zeros([1, 4, 2, 2], DType::F32);
    let subject = Subject { embedding: Tensor::zeros([1, 1, 8], DType::F32), latent, elevation: 0.5, seen: None };
    let settings = SamplerSettings { steps: 4, ..SamplerSettings::default() };
    let mut run = Sampling::begin(subject, settings, 3)?;
    run.step(&Doubter, &mut |_| Ok(()))?;
    let mut other = Sampling::from_file(&run.to_file())?;
    while !run.is_finished() {
        run.step(&Doubter, &mut |_| Ok(()))?;
        other.step(&Doubter, &mut |_| Ok(()))?;
    }
    assert_eq!(run.latents().slice::<f32>(), other.latents().slice::<f32>());
    Ok(())
}
