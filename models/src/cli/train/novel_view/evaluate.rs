//! Evaluation of a trained model on held-out objects, with and without its spatial-aware module.

use std::path::Path;

use gradreel::{Error, ErrorKind, Result};

use super::NovelView;
use super::meshes::Objects;
use super::sampled::{rows, sampled, score};
use super::samples::unseen;
use super::settings::{Settings, Stage};
use crate::cli::network;
use crate::cli::output::{say, tell};
use crate::report::animation::Picture;
use crate::report::synthesis::sheet;
use crate::runtime::progress::Progress;
use crate::runtime::run_folder::RunFolder;
use crate::views::objects::SampleSettings;
use crate::views::{DenoiserSizes, Detector, Ensemble, ModelSizes, SamplerSettings, Score};

/// Number of objects whose pictures are saved.
const SHOWN: usize = 8;

/// Measures the model and prints a table.
pub(super) fn run(arguments: &NovelView, count: usize, progress: &Progress) -> Result<()> {
    if count == 0 {
        return Err(Error::new(ErrorKind::Input, "there is nothing to show")
            .at("--evaluate")
            .found(0)
            .wanted("a number of objects")
            .fix("100 objects give the mean to a few percent"));
    }
    let (mut settings, weights) = Settings::resolve_from(arguments, Stage::SpatialAware)?;
    let path = weights.as_ref().map(|weights| weights.path().to_owned()).unwrap_or_default();
    let weights = network::open(path, &settings.device.device()?)?;
    settings.model = weights.sizes()?;
    let objects = Objects::open(&mut settings, progress)?;
    let sizes = &settings.model;
    weights.check(&sizes.weights()?).into_result()?;
    let bare =
        ModelSizes { denoiser: DenoiserSizes { spatial_aware: None, ..sizes.denoiser.clone() }, ..sizes.clone() };
    let at_once = settings.device.at_once(sizes.denoiser.ring.views);
    let folder = match &arguments.out {
        Some(folder) => RunFolder::create(folder)?,
        None => RunFolder::create_free(Path::new("runs"), "novel-view-evaluation")?,
    };
    folder.write("settings.toml", settings.to_toml().as_bytes())?;
    objects.list(&folder)?;
    if let Some(told) = objects.described().filter(|_| !arguments.quiet) {
        tell!("{told}");
    }
    let ensemble = |sizes: &ModelSizes| Ensemble::new(&weights, &sizes.denoiser, weights.device(), at_once);
    let whole = ensemble(sizes)?;
    let without = sizes.denoiser.spatial_aware.as_ref().map(|_| ensemble(&bare)).transpose()?;
    let models = match &without {
        Some(without) => vec![
            ("box and distance", sizes, &whole, Detector::EXACT),
            ("box", sizes, &whole, Detector::FLAT),
            ("without the module", &bare, without, Detector::FLAT),
        ],
        None => vec![("the model", sizes, &whole, Detector::FLAT)],
    };
    let stage = progress.stage("sampling", (count * models.len()) as u64);
    let mut scores: Vec<Vec<Score>> = vec![Vec::new(); models.len()];
    let mut table = "object,model,centre_error,box_iou,psnr_db,silhouette_iou\n".to_owned();
    let columns = 8.min(sizes.denoiser.ring.views);
    for (number, sample) in unseen(&settings, &objects, count)?.iter().enumerate() {
        let mut shown = Vec::new();
        for (which, (name, sizes, ensemble, detector)) in models.iter().enumerate() {
            let sampler = SamplerSettings {
                steps: settings.validation.steps,
                guidance: settings.validation.guidance,
                seed: number as u64,
            };
            let found = sampled(&weights, sizes, ensemble, sample, *detector, sampler)?;
            let found_score = score(&found, sample)?;
            let Score { centre, overlap, psnr, silhouette } = found_score;
            table += &format!("{number},{name},{centre},{overlap},{psnr},{silhouette}\n");
            scores[which].push(found_score);
            shown.extend(rows(&found, sample, columns)?);
            stage.set((number * models.len() + which + 1) as u64, &format!("centre off by {:.1} %", 100.0 * centre));
        }
        if number < SHOWN {
            let picture = sheet(&[Picture::grid(columns + 1, &shown)], 2)?;
            folder.write(&format!("objects/{number:03}.png"), &picture)?;
        }
        folder.write("objects.csv", table.as_bytes())?;
    }
    stage.finish("");
    print(&models.iter().map(|(name, ..)| *name).collect::<Vec<_>>(), &scores, settings.data, sizes.image);
    say!("\n  {}", folder.path("objects.csv").display());
    Ok(())
}

fn print(names: &[&str], scores: &[Vec<Score>], data: SampleSettings, image: usize) {
    say!(
        "\n{} unseen objects, scales {} to {}, reach {}, images of {image} pixels\n",
        scores[0].len(),
        data.scale[0],
        data.scale[1],
        data.reach
    );
    say!(
        "{:<18} {:>14} {:>14} {:>8} {:>10} {:>15}",
        "",
        "centre error",
        "(median)",
        "box IoU",
        "PSNR [dB]",
        "silhouette IoU"
    );
    for (name, scores) in names.iter().zip(scores) {
        let Score { centre, overlap, psnr, silhouette } = Score::mean(scores);
        let mut each: Vec<f64> = scores.iter().map(|score| score.centre).collect();
        each.sort_by(f64::total_cmp);
        let median = each[each.len() / 2];
        say!(
            "{name:<18} {:>12.2} % {:>12.2} % {overlap:>8.3} {psnr:>10.2} {silhouette:>15.3}",
            100.0 * centre,
            100.0 * median
        );
    }
    if let [lifted, flat, without] = scores {
        let factor = |with: &[Score]| Score::mean(without).centre / Score::mean(with).centre.max(1e-9);
        let (lifted, flat) = (factor(lifted), factor(flat));
        say!(
            "\nthe module, told box and distance, cuts the centre error by a factor of {lifted:.2}; told the box alone, {flat:.2}"
        );
    }
}
