//! `gradreel train`: training of models.

mod curves;
mod depth;
mod feed;
mod log;
mod novel_view;
mod toml_file;

use gradreel::Result;

/// Arguments of `gradreel train`.
#[derive(clap::Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    task: Task,
}

#[derive(clap::Subcommand)]
enum Task {
    /// Train the model that synthesizes the views around an object
    NovelView(Box<novel_view::NovelView>),
    /// Train the network that tells front and back depth from one masked picture
    Depth(Box<depth::Depth>),
}

/// Trains or evaluates a model.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    match &arguments.task {
        Task::NovelView(arguments) => novel_view::run(arguments),
        Task::Depth(arguments) => depth::run(arguments),
    }
}
