//! `gradreel bench figure5`: where the object is in the views, with and without the spatial-aware module.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use gradreel::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

use super::AblationArguments;
use super::films;
use super::job::{self, Plan};
use crate::ablation::{Placed, Truth, Ways, measure};
use crate::cli::output::say;
use crate::report::animation::Picture;
use crate::report::page::Drawing;
use crate::report::png_file::png;
use crate::report::results_file::{self, Measured, Section};
use crate::runtime::interrupt;
use crate::runtime::progress::Progress;
use crate::runtime::run_folder::RunFolder;

/// Frames of a film that are looked at, evenly over it.
const FRAMES: usize = 3;

/// What was measured of a film.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Row {
    film: String,
    frames: Vec<usize>,
    ways: Vec<(Ways, Placed)>,
    seconds: f64,
}

/// Measures all films that are left, and writes picture and table.
pub(super) fn run(arguments: &AblationArguments) -> Result<()> {
    interrupt::install()?;
    let progress = Progress::new(arguments.common.quiet);
    let (plan, folder) = if arguments.common.resume { job::go_on(arguments)? } else { job::begin(arguments)? };
    let go_on = |error: Error| match error.kind() {
        ErrorKind::Interrupted => {
            error.fix(format!("go on with `gradreel bench figure5 --out {} --resume`", folder.root().display()))
        }
        _ => error,
    };
    if let Some(wanted) = plan.films {
        films::make(&folder, wanted, &progress).map_err(go_on)?;
    }
    let mut rows: Vec<Row> = Vec::new();
    let bar = progress.stage("figure 5", plan.clips.len() as u64);
    for (number, path) in plan.clips.iter().enumerate() {
        let name = job::label(path, plan.clips.iter().take(number));
        let file = format!("figure5/{name}.json");
        let row = match folder.has(&file) {
            true => serde_json::from_slice(&folder.read(&file)?).map_err(|e| job::damaged(&folder, &file, &e))?,
            false => look(&plan, number, &name, &folder, &|text| bar.set(number as u64, &format!("{name}: {text}")))
                .map_err(go_on)?,
        };
        rows.push(row);
    }
    bar.finish("");
    let table = table(&rows);
    folder.write("figure5.md", format!("# Figure 5\n\n{table}").as_bytes())?;
    let shown = rows.iter().map(|row| format!("figure5/{}.png", row.film)).collect::<Vec<_>>();
    folder.write("figure5.svg", figure(&folder, &shown)?.as_bytes())?;
    if let Some(file) = &arguments.common.markdown {
        let section = Section {
            name: if plan.coarse { "figure5-quick".into() } else { "figure5".into() },
            title: "Objects at their place in the views".into(),
            split: match plan.films {
                Some(_) => "development: films of examples/scenes/families".into(),
                None => "clips that were given on the command line".into(),
            },
            body: table.clone(),
        };
        results_file::replace(file, &section, &Measured::here("gradreel"))?;
    }
    say!("{table}");
    say!("  {}", folder.path("figure5.svg").display());
    Ok(())
}

/// Measures a film.
fn look(plan: &Plan, number: usize, name: &str, folder: &RunFolder, said: &dyn Fn(&str)) -> Result<Row> {
    let since = std::time::Instant::now();
    let path = &plan.clips[number];
    let settings = plan.settings_of(Truth::beside(path).as_ref());
    let clip = job::open(path, &settings)?;
    let count = clip.frame_count();
    let mut frames: Vec<usize> = (0..FRAMES).map(|k| k * (count - 1) / (FRAMES - 1)).collect();
    frames.dedup();
    let place = folder.path(&format!("figure5/{name}"));
    std::fs::create_dir_all(&place).map_err(|e| Error::io(&place, "make a folder of the bench", &e))?;
    let made = RunFolder::open(&place)?;
    let config = settings.config.published.clone().unwrap_or_default();
    let (primary, gravity) = (settings.primary_of(&clip), settings.config.world.gravity);
    let (ways, picture) = measure(&clip, primary, &config, gravity, &frames, &made, &mut |text| {
        said(text);
        interrupt::check()
    })?;
    folder.write(&format!("figure5/{name}.png"), &png(&enlarged(&picture))?)?;
    let row = Row { film: name.to_owned(), frames, ways, seconds: since.elapsed().as_secs_f64() };
    let text = serde_json::to_vec_pretty(&row).map_err(job::unwritable)?;
    folder.write(&format!("figure5/{name}.json"), &text)?;
    Ok(row)
}

/// Small pictures of twice the size.
fn enlarged(picture: &Picture) -> Picture {
    let (width, height) = (2 * picture.width, 2 * picture.height);
    let pixels = picture.rgb.as_chunks::<3>().0;
    let rgb = (0..width * height).flat_map(|i| pixels[i / width / 2 * picture.width + i % width / 2]).collect();
    Picture { width, height, rgb }
}

/// Position errors and overlaps, a line a film and way, and their means.
fn table(rows: &[Row]) -> String {
    let mut text = String::from(
        "| film | views | centre off by (of the picture) | IoU of boxes | without an object |\n| --- | --- | --- | --- | --- |\n",
    );
    let mut means: BTreeMap<Ways, Vec<Placed>> = BTreeMap::new();
    let mut line = |film: &str, way: Ways, placed: &Placed| {
        let (centre, overlap, empty) = (100.0 * placed.centre, placed.overlap, 100.0 * placed.empty);
        writeln!(text, "| {film} | {} | {centre:.1} % | {overlap:.2} | {empty:.0} % |", way.label())
            .expect("a string accepts every write");
    };
    for row in rows {
        for (way, placed) in &row.ways {
            line(&row.film, *way, placed);
            means.entry(*way).or_default().push(*placed);
        }
    }
    for (way, all) in means.iter().filter(|_| rows.len() > 1) {
        let mean = |of: fn(&Placed) -> f64| all.iter().map(of).sum::<f64>() / all.len() as f64;
        let views = all.iter().map(|placed| placed.views).sum();
        let mean = Placed { centre: mean(|p| p.centre), overlap: mean(|p| p.overlap), empty: mean(|p| p.empty), views };
        line("all", *way, &mean);
    }
    let seconds: f64 = rows.iter().map(|row| row.seconds).sum();
    writeln!(
        text,
        "\nFrames {:?} of each film; the true place is that of the hull of all its cameras. {seconds:.0} s.",
        rows.first().map_or(&[][..], |row| &row.frames)
    )
    .expect("a string accepts every write");
    text
}

/// The pictures of all films below each other, with what their rows are.
fn figure(folder: &RunFolder, pictures: &[String]) -> Result<String> {
    const LINE: usize = 22;
    let mut body = String::new();
    let (mut top, mut widest) = (0, 0);
    for name in pictures {
        let bytes = folder.read(name)?;
        let [width, height] = Drawing::size_of(&bytes);
        let film = name.trim_start_matches("figure5/").trim_end_matches(".png");
        let rows = Ways::ALL.map(Ways::label).join("; ");
        write!(
            body,
            "<text x=\"4\" y=\"{}\" font-size=\"13\" font-family=\"sans-serif\">{film}: {rows}. Framed: where the object is.</text>\n\
             <image y=\"{}\" width=\"{width}\" height=\"{height}\" href=\"data:image/png;base64,{}\"/>\n",
            top + LINE - 7,
            top + LINE,
            crate::report::base64::encode(&bytes)
        )
        .expect("a string accepts every write");
        top += LINE + height;
        widest = widest.max(width);
    }
    Ok(format!("<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {widest} {top}\">\n{body}</svg>\n"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_has_a_line_for_each_way_and_their_means() {
        let placed = |centre: f64| Placed { centre, overlap: 0.5, empty: 0.0, views: 48 };
        let row = |film: &str, centre: f64| Row {
            film: film.into(),
            frames: vec![0, 6, 13],
            ways: Ways::ALL.iter().map(|way| (*way, placed(centre))).collect(),
            seconds: 1.0,
        };
        let text = table(&[row("a", 0.02), row("b", 0.04)]);
        assert_eq!(text.lines().filter(|line| line.contains("without it")).count(), 3, "{text}");
        assert!(text.contains("| all | with the spatial-aware module | 3.0 % | 0.50 | 0 % |"), "{text}");
        assert!(!table(&[row("a", 0.02)]).contains("| all |"));
    }
}
