//! What a run leaves: independent readers see what was written, and the page holds everything itself, lets no foreign text
//! run, and hides nothing silently.

mod browser;
mod examples;
mod exchange;
mod markup;
mod page;
mod plot;
mod results_file;
