//! The page of a training: its curves.

use super::settings::Settings;
use crate::cli::train::curves::{column, curve, plot};
use crate::cli::train::log::Log;
use crate::report::page::Page;

/// The page as HTML.
pub(super) fn page(settings: &Settings, log: &Log) -> String {
    let (steps, looks) = (log.steps(), log.looks());
    let files = [
        ("model.safetensors", "the averaged weights"),
        ("previews/", "pictures of unseen shapes; true front and back, and predicted ones below"),
        ("log.csv", "loss, errors, rate and gradient of every step"),
        ("validation.csv", "agreement on unseen shapes"),
        ("settings.toml", "everything that decided the result"),
        ("state.safetensors", "where --resume goes on"),
    ];
    let overlaps = vec![
        curve("network", column(&looks, 1)),
        curve("as deep as wide", column(&looks, 2)),
        curve("training pictures, parallel rays", column(&steps, 3)),
    ];
    let errors = vec![curve("front", column(&looks, 3)), curve("back", column(&looks, 4))];
    Page {
        title: "layered depth",
        subtitle: format!("{} of {} steps", steps.last().map_or(0.0, |row| row[0]), settings.steps),
        headlines: vec![],
        animation: None,
        animation_caption: String::new(),
        drawings: vec![],
        scene: None,
        plots: vec![
            plot("Overlap with the true body", "IoU [1]", false, overlaps),
            plot("Errors on unseen shapes, up to a shift", "rms [D]", false, errors),
            plot(
                "Tilts above 20° to the wrong side",
                "share [1]",
                false,
                vec![curve("unseen shapes", column(&looks, 5))],
            ),
            plot("Loss", "loss [1]", false, vec![curve("steps", column(&steps, 1))]),
        ],
        notes: vec![],
        timings: vec![],
        config_toml: settings.to_toml(),
        files: files.map(|(link, what)| (link.to_owned(), what.to_owned())).to_vec(),
    }
    .html()
}
