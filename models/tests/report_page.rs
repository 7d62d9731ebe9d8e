//! The page of the output folder: it holds everything itself, lets no foreign text run, and hides nothing silently.

#[path = "report_page/browser.rs"]
mod browser;
#[path = "report_page/markup.rs"]
mod markup;
#[path = "report_page/page.rs"]
mod page;
#[path = "report_page/plot.rs"]
mod plot;
