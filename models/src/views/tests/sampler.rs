//! Whole runs of the sampler: the stored trajectory, the same bits however it is run, and states that can be gone on with.

use crate::layers::{Init, Weights};
use crate::views::{
    Autoencoder, Condition, Ddim, Ensemble, Look, MemoryEstimate, Moment, Predictor, SamplerSettings, Sampling,
    Schedule, Subject, Target, decode,
};
use gradreel::io::TensorFile;
use gradreel::{DType, Device, Error, ErrorKind, Result, Shape, Tape, Tensor, Var};
use rayon::ThreadPoolBuilder;

use super::harness::{Case, close, load, places};
use super::procedural::Source;
use super::{sampling, tiny};

/// Gives out recorded noise `[1, views, c, h, w]`.
struct Recorded(Tensor);

impl Predictor for Recorded {
    fn predict(
        &self,
        moment: &Moment<'_>,
        views: &[usize],
        found: &mut dyn FnMut(usize, Tensor) -> Result<()>,
    ) -> Result<()> {
        assert_eq!(moment.latents.dims(), self.0.dims());
        // in any order
        views.iter().rev().try_for_each(|&view| {
            let tape = Tape::new();
            let of_view = tape.constant(self.0.clone()).select(0, 0).slice(0, view..view + 1);
            found(view, of_view.value()?.clone())
        })
    }
}

#[test]
fn the_stored_trajectory() {
    let file = load("schedule");
    for dtype in [DType::F64, DType::F32] {
        let turn = |name: &str, step: usize| {
            let all = Tape::new().constant(file.get(name).unwrap().cast(dtype).unwrap());
            all.select(0, step).value().unwrap().clone()
        };
        let steps = file.get("traj.eps").unwrap().dims()[0];
        let start = turn("traj.x", 0);
        let mut latent = start.dims()[1..].to_vec();
        latent[0] = 1;
        let subject = Subject {
            embedding: Tensor::zeros([1, 1, 4], dtype),
            latent: Tensor::zeros(latent, dtype),
            elevation: 0.0,
            seen: None,
        };
        let settings = SamplerSettings { steps, ..SamplerSettings::default() };
        let mut run = Sampling::begin_from(subject, settings, start).unwrap();
        assert_eq!(run.steps(), steps);
        for step in 0..steps {
            run.predict(&Recorded(turn("traj.eps", step)), &mut |_| Ok(())).unwrap();
            run.update(&turn("traj.noise", step)).unwrap();
            close(&format!("{dtype} step {step}"), run.latents(), &turn("traj.x", step + 1), 2e-5);
        }
        assert!(run.is_finished());
        // the last step adds no noise and nearly all that it predicts is clean
        close("the clean latents", run.latents(), run.clean().unwrap(), 0.1);
    }
}

/// A run whose next step has this index.
fn at_index(subject: Subject, settings: SamplerSettings, latents: &Tensor, index: usize) -> Sampling {
    let fresh = Sampling::begin_from(subject, settings, latents.clone()).unwrap();
    let mut file = fresh.to_file();
    let text = file.metadata.get_mut("gradreel.sampling").unwrap();
    let mut numbers: serde_json::Value = serde_json::from_str(text).unwrap();
    numbers["done"] = (fresh.steps() - 1 - index).into();
    *text = numbers.to_string();
    Sampling::from_file(&file).unwrap()
}

#[test]
fn the_stored_steps_with_guidance() {
    let file = load("denoise_step");
    for place in places() {
        let case = Case::new(&file, &place);
        let sizes = sampling::sizes(&case, case.dims("in.x")[2]);
        let given = |name: &str| case.given(name).value().unwrap().to_device(&Device::Cpu).unwrap();
        let scaled = case.given("in.x_input");
        if scaled.device() != Device::Cpu {
            continue; // as large as this, a processor that stands in for a GPU takes a minute
        }
        let latent = (&scaled / Autoencoder::SCALE).value().unwrap().to_device(&Device::Cpu).unwrap();
        let subject =
            Subject { embedding: given("in.clip_embed"), latent, elevation: case.numbers("elevation")[0], seen: None };
        let ensemble = Ensemble::new(&case, &sizes, &Device::Cpu, 2).unwrap();
        for turn in sampling::turns(&file) {
            let index = case.numbers(&format!("{turn}.index"))[0] as usize;
            for guidance in sampling::guidances(&file, &turn) {
                let settings = SamplerSettings { steps: case.size("ddim_steps"), guidance, seed: 0 };
                let mut run = at_index(subject.clone(), settings, &given("in.x"), index);
                run.predict(&ensemble, &mut |_| Ok(())).unwrap();
                run.update(&given(&format!("in.{turn}.noise"))).unwrap();
                let name = format!("out.{turn}.cfg{guidance}.x_prev");
                close(&name, run.latents(), file.get(&name).unwrap(), 1e-4);
            }
        }
        assert_eq!(case.tape.memory().peak, 0, "nothing is kept for gradients");
    }
}

const SETTINGS: SamplerSettings = SamplerSettings { steps: 3, guidance: 1.5, seed: 7 };

fn source() -> Source {
    Source { seed: "tiny", tape: Tape::new() }
}

fn ensemble(at_once: usize) -> Ensemble {
    Ensemble::new(&source(), &tiny::sizes().denoiser, &Device::Cpu, at_once).unwrap()
}

fn begin() -> Sampling {
    Sampling::begin(tiny::subject(), SETTINGS, 4).unwrap()
}

fn finish(mut run: Sampling, ensemble: &Ensemble) -> Vec<u32> {
    while !run.is_finished() {
        run.step(ensemble, &mut |_| Ok(())).unwrap();
    }
    bits(run.latents())
}

fn bits(tensor: &Tensor) -> Vec<u32> {
    assert!(tensor.all_finite().unwrap());
    tensor.slice::<f32>().iter().map(|v| v.to_bits()).collect()
}

#[test]
fn the_bits_do_not_depend_on_threads_or_views_at_once() {
    let expected = finish(begin(), &ensemble(1));
    for threads in [1, 2, 3] {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        for at_once in [1, 2, 4] {
            let found = pool.install(|| finish(begin(), &ensemble(at_once)));
            assert!(found == expected, "{threads} threads, {at_once} views at once");
        }
    }
    let other = Sampling::begin(tiny::subject(), SamplerSettings { seed: 8, ..SETTINGS }, 4).unwrap();
    assert_ne!(finish(other, &ensemble(1)), expected);
    // a view's noise is its own: fewer views start from the same numbers
    let fewer = Sampling::begin(tiny::subject(), SETTINGS, 2).unwrap();
    assert_eq!(bits(fewer.latents()), bits(begin().latents())[..bits(fewer.latents()).len()]);
}

#[test]
fn a_run_goes_on_in_the_middle_of_a_step_with_the_same_bits() {
    let (one, two) = (ensemble(1), ensemble(2));
    let expected = finish(begin(), &one);
    for (stopped_after, predictor, other) in [(2, &one, &two), (3, &two, &one)] {
        let mut run = begin();
        run.step(predictor, &mut |_| Ok(())).unwrap();
        let mut stop = |known: usize| match known {
            known if known >= stopped_after => Err(Error::new(ErrorKind::Interrupted, "enough")),
            _ => Ok(()),
        };
        let error = run.step(predictor, &mut stop).unwrap_err();
        assert_eq!((error.kind(), run.done()), (ErrorKind::Interrupted, 1));
        assert!((stopped_after..=4).contains(&run.known()), "{}", run.known());
        let bytes = run.to_file().to_bytes().unwrap();
        let again = Sampling::from_file(&TensorFile::from_bytes(&bytes).unwrap()).unwrap();
        assert_eq!((again.known(), again.done(), again.settings()), (run.known(), 1, &SETTINGS));
        // what is known is not asked for again
        let mut counts = Vec::new();
        let mut count = |known| {
            counts.push(known);
            Ok(())
        };
        again.clone().step(other, &mut count).unwrap();
        assert!(counts.iter().copied().eq(run.known() + 1..=4), "{counts:?}");
        assert!(finish(again, other) == expected);
        assert!(finish(run, predictor) == expected, "nor is anything lost in memory");
    }
}

#[test]
fn a_gpu_predicts_what_the_cpu_predicts() {
    let Ok(device) = Device::gpu() else { return };
    struct OnDevice(Source, Device);
    impl Weights for OnDevice {
        fn weight(&self, path: &str, shape: &Shape, init: Init) -> Result<Var> {
            let weight = self.0.weight(path, shape, init)?;
            Ok(self.0.tape.constant(weight.value()?.to_device(&self.1)?))
        }
    }
    let on_gpu = OnDevice(source(), device.clone());
    let on_gpu = Ensemble::new(&on_gpu, &tiny::sizes().denoiser, &device, 3).unwrap();
    let mut runs = [begin(), begin()];
    runs[0].step(&ensemble(2), &mut |_| Ok(())).unwrap();
    runs[1].step(&on_gpu, &mut |_| Ok(())).unwrap();
    close("latents", runs[1].latents(), runs[0].latents(), 1e-4);
    close("clean", runs[1].clean().unwrap(), runs[0].clean().unwrap(), 1e-4);
}

#[test]
fn a_damaged_state_is_refused() {
    let mut run = begin();
    run.step(&ensemble(1), &mut |_| Ok(())).unwrap();
    let whole = run.to_file();
    let mut changed: Vec<(&str, TensorFile)> = Vec::new();
    let mut change = |what: &'static str, with: &dyn Fn(&mut TensorFile)| {
        let mut file = whole.clone();
        with(&mut file);
        changed.push((what, file));
    };
    let put = |name: &'static str, tensor: Tensor| {
        move |file: &mut TensorFile| drop(file.tensors.insert(name.to_owned(), tensor.clone()))
    };
    change("sampling", &|file| file.metadata.clear());
    let other = |text: &'static str| {
        move |file: &mut TensorFile| drop(file.metadata.insert("gradreel.sampling".into(), text.to_owned()))
    };
    change("sampling", &other(r#"{"steps":3,"seed":7,"done":9}"#));
    change("steps", &other(r#"{"steps":0,"seed":7,"done":0}"#));
    change("sampling", &other(r#"{"steps":3,"seed":7}"#));
    change("latents", &|file| drop(file.tensors.remove("latents")));
    change("latents", &put("latents", Tensor::zeros([1, 4, 4, 8, 7], DType::F32)));
    change("latents", &put("latents", Tensor::zeros([1, 4, 4, 8, 8], DType::F64)));
    change("latents", &put("latents", Tensor::full(f64::NAN, [1, 4, 4, 8, 8], DType::F32)));
    change("embedding", &|file| drop(file.tensors.remove("embedding")));
    change("predicted.1", &put("predicted.1", Tensor::zeros([1, 4, 8, 7], DType::F32)));
    change("elevation", &put("elevation", Tensor::zeros([1], DType::F32)));
    change("guidance", &put("guidance", Tensor::full(f64::INFINITY, [1], DType::F64)));
    for (what, file) in changed {
        let error = Sampling::from_file(&file).unwrap_err().to_string();
        assert!(error.contains(what), "no {what:?} in {error}");
    }
    assert!(Sampling::from_file(&whole).is_ok());
}

#[test]
fn settings_without_sense_are_refused() {
    let refused = |subject: Subject, settings: SamplerSettings, views: usize, part: &str| {
        let error = Sampling::begin(subject, settings, views).unwrap_err();
        assert!(error.kind() == ErrorKind::Input && error.to_string().contains(part), "{error}");
    };
    refused(tiny::subject(), SamplerSettings { steps: 0, ..SETTINGS }, 4, "steps");
    refused(tiny::subject(), SamplerSettings { guidance: f64::NAN, ..SETTINGS }, 4, "guidance");
    refused(tiny::subject(), SETTINGS, 0, "views");
    refused(Subject { elevation: 30.0, ..tiny::subject() }, SETTINGS, 4, "elevation");
}

#[test]
fn a_prediction_that_is_no_number_is_named() {
    let run = begin();
    let mut numbers = vec![0.5f32; run.latents().len()];
    numbers[2 * 4 * 64 + 3] = f32::NAN;
    let noise = Recorded(Tensor::from_vec(numbers, run.latents().shape().clone()));
    let error = { run }.step(&noise, &mut |_| Ok(())).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::NonFinite);
    assert!(error.to_string().contains("view 2, step 1"), "{error}");
}

#[test]
fn sampling_keeps_nothing_for_gradients() {
    let ensemble = ensemble(1);
    let tape = Tape::new();
    let subject = tiny::subject();
    let condition: Condition = subject.condition(&tape, &Device::Cpu).unwrap();
    let latents = tape.constant(begin().latents().clone());
    let look: Look = ensemble.denoiser().look(&latents, &[601], &condition).unwrap();
    let noise = ensemble.denoiser().noise(&look, &condition, &[Target { sample: 0, view: 1 }], 1.5).unwrap();
    assert!(!noise.is_differentiable() && noise.value().unwrap().all_finite().unwrap());
    assert_eq!(tape.memory().peak, 0);
}

#[test]
fn the_same_run_with_plain_variables() {
    // the steps by hand, all views in one batch
    let (denoiser, tape) = (ensemble(1), Tape::new());
    let denoiser = denoiser.denoiser();
    let condition = tiny::subject().condition(&tape, &Device::Cpu).unwrap();
    let mut run = begin();
    run.step(&ensemble(2), &mut |_| Ok(())).unwrap();
    let ddim = Ddim::new(&Schedule::published(), SETTINGS.steps).unwrap();
    let index = ddim.len() - 2;
    let x = tape.constant(run.latents().clone());
    let look = denoiser.look(&x, &[ddim.times[index]], &condition).unwrap();
    let targets: Vec<Target> = (0..4).map(|view| Target { sample: 0, view }).collect();
    let noise = denoiser.noise(&look, &condition, &targets, SETTINGS.guidance).unwrap().reshape(x.shape().clone());
    run.predict(&ensemble(2), &mut |_| Ok(())).unwrap();
    run.update(&Tensor::zeros(x.shape().clone(), DType::F32)).unwrap();
    let next = ddim.step(index, &x, &noise, &(&x * 0.0));
    close("next", run.latents(), next.value().unwrap(), 2e-5);
    close("clean", run.clean().unwrap(), ddim.clean(index, &x, &noise).value().unwrap(), 2e-5);
}

#[test]
fn a_picture_becomes_a_subject_and_latents_become_pictures() {
    let sizes = tiny::sizes();
    let encode = |seed: u64| {
        let key = SamplerSettings { seed, ..SETTINGS }.picture_key();
        Subject::encode(&source(), &sizes, &tiny::picture(), 0.4, key, &Device::Cpu).unwrap()
    };
    let subject = encode(7);
    assert_eq!((subject.embedding.dims(), subject.latent.dims()), (&[1, 1, 8][..], &[1, 4, 8, 8][..]));
    assert_eq!(bits(&subject.latent), bits(&encode(7).latent));
    assert_ne!(bits(&subject.latent), bits(&encode(8).latent));
    let run = begin();
    let mut seen = Vec::new();
    decode(&source(), &sizes, run.latents(), &[3, 1], &Device::Cpu, &mut |view, picture| {
        assert_eq!(picture.dims(), [3, 16, 16]);
        seen.push((view, bits(&picture)));
        Ok(())
    })
    .unwrap();
    assert_eq!(seen.iter().map(|(view, _)| *view).collect::<Vec<_>>(), [3, 1]);
    assert_ne!(seen[0].1, seen[1].1);
}

#[test]
fn weights_that_are_being_trained_do_as_well() {
    struct Leaves(Source);
    impl Weights for Leaves {
        fn weight(&self, path: &str, shape: &Shape, init: Init) -> Result<Var> {
            Ok(self.0.tape.leaf(self.0.weight(path, shape, init)?.value()?.clone()))
        }
    }
    let (sizes, key) = (tiny::sizes(), SETTINGS.picture_key());
    let made = |weights: &dyn Weights| {
        let subject = Subject::encode(weights, &sizes, &tiny::picture(), 0.4, key, &Device::Cpu).unwrap();
        let mut all = vec![bits(&subject.embedding), bits(&subject.latent)];
        let mut keep = |_, picture: Tensor| {
            all.push(bits(&picture));
            Ok(())
        };
        decode(weights, &sizes, begin().latents(), &[2], &Device::Cpu, &mut keep).unwrap();
        all
    };
    let leaves = Leaves(source());
    assert_eq!(made(&leaves), made(&source()));
    assert_eq!(leaves.0.tape.memory().peak, 0);
}

#[test]
fn views_at_once_stay_within_the_budget() {
    let published = MemoryEstimate::of(&crate::views::ModelSizes::published(), 4);
    let budget = 2_000_000_000;
    let most = published.at_once(budget, 16).unwrap();
    assert!(most < 16 && published.total(most) <= budget && published.total(most + 1) > budget, "{most}");
    assert_eq!(published.at_once(usize::MAX / 2, 16).unwrap(), 16);
    assert_eq!(published.at_once(published.total(1), 16).unwrap(), 1);
    let error = published.at_once(published.total(1) - 1, 16).unwrap_err().to_string();
    assert!(error.contains("budget") && error.contains("MB"), "{error}");
    // never less than the arrays that are there for certain: the un-projected volume, the frustum and the largest weight,
    // a picture between the decoder's last levels
    assert!(published.shared >= 16 * 16 * 32 * 32 * 32 * 4);
    assert!(published.view >= 64 * 48 * 32 * 32 * 4 + 2560 * 1280 * 9 * 4);
    assert!(published.decoding >= 256 * 256 * 256 * 4);
}
