//! The page of a training: its curves.

use super::settings::Settings;
use crate::cli::train::curves::{column, curve, plot};
use crate::cli::train::log::Log;
use crate::report::page::Page;

/// The page as HTML.
pub(super) fn page(settings: &Settings, log: &Log) -> String {
    let (steps, looks) = (log.steps(), log.looks());
    let seen = curve("steps", column(&steps, 1));
    let unseen = curve("unseen objects", column(&looks, 1));
    let shares = vec![
        curve("distance of the middles", column(&looks, 2)),
        curve("IoU of boxes", column(&looks, 3)),
        curve("IoU of silhouettes", column(&looks, 5)),
    ];
    let files = [
        ("model.safetensors", "the whole model, when the training is done"),
        ("previews/", "input, true views and below them sampled views of unseen objects"),
        ("log.csv", "loss, rate and gradient of every step"),
        ("validation.csv", "loss and agreement of views on unseen objects"),
        ("settings.toml", "everything that decided the result"),
        ("state.safetensors", "where --resume goes on"),
    ];
    Page {
        title: "novel views",
        subtitle: format!("{} of {} steps", steps.last().map_or(0.0, |row| row[0]), settings.steps),
        headlines: vec![],
        animation: None,
        animation_caption: String::new(),
        drawings: vec![],
        scene: None,
        plots: vec![
            plot("Mean squared error of the noise", "loss [1]", true, vec![seen, unseen]),
            plot("Sampled views of unseen objects", "share [1]", false, shares),
            plot("Colours of these views", "PSNR [dB]", false, vec![curve("mean", column(&looks, 4))]),
        ],
        notes: vec![],
        timings: vec![],
        config_toml: settings.to_toml(),
        files: files.map(|(link, what)| (link.to_owned(), what.to_owned())).to_vec(),
    }
    .html()
}
