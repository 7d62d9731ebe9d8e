//! The page in a real browser without a screen: the player starts, draws the particles and moves them.
//!
//! Needs Chromium or Chrome; without one the test says so and passes, unless `CI` is `true`.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::report::page::{Headline, Page, Scene};
use tempfile::TempDir;

/// A browser on the path, or the one that `CHROMIUM` names.
fn browser() -> Option<PathBuf> {
    if let Some(given) = std::env::var_os("CHROMIUM") {
        return Some(given.into());
    }
    let folders = std::env::var_os("PATH")?;
    let names = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];
    std::env::split_paths(&folders).flat_map(|folder| names.map(|name| folder.join(name))).find(|path| path.is_file())
}

/// How often the page is opened at most: a browser whose process of drawing ends as it starts gives the page no WebGL.
const OPENED: usize = 5;

fn run(browser: &Path, folder: &Path, arguments: &[&str]) -> String {
    let profile = TempDir::new_in(folder).unwrap();
    let output = Command::new(browser)
        .args([
            "--headless=new",
            "--no-sandbox",
            "--disable-dev-shm-usage",
            "--hide-scrollbars",
            "--window-size=900,1400",
        ])
        .args([
            "--use-gl=angle",
            "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader",
            "--virtual-time-budget=4000",
        ])
        // whatever the page would ask the network for fails
        .args(["--proxy-server=127.0.0.1:9", "--no-first-run", "--disable-background-networking"])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .args(arguments)
        .arg(format!("file://{}", folder.join("index.html").display()))
        .output()
        .expect("the browser starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Pixels that are clearly magenta, the colour of the particles and of nothing else on the page.
fn magenta(png: &Path) -> usize {
    let image = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(png).unwrap()));
    let mut reader = image.read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    let channels = info.color_type.samples();
    let is = |p: &&[u8]| p[0] > 90 && p[2] > 90 && p[1] < p[0] / 2 && p[1] < p[2] / 2;
    bytes[..info.buffer_size()].chunks_exact(channels).filter(is).count()
}

#[test]
fn the_player_draws_and_plays_in_a_browser() {
    let Some(browser) = browser() else {
        assert!(std::env::var("CI").as_deref() != Ok("true"), "no Chromium on this machine, and CI wants one");
        println!("no Chromium on this machine: the page was not opened");
        return;
    };
    let cube: Vec<[f32; 3]> = (0..1000)
        .map(|i| [i / 100, i / 10 % 10, i % 10].map(|k| 0.02 * k as f32))
        .map(|[x, y, z]| [x, y + 0.3, z])
        .collect();
    let fallen = cube.iter().map(|[x, y, z]| [*x, y - 0.3, *z]).collect();
    let page = Page {
        title: "A cube falls",
        subtitle: String::new(),
        headlines: vec![Headline {
            symbol: "E".into(),
            label: "Young's modulus".into(),
            readable: "301 kPa".into(),
            exact: "3.01e5 Pa".into(),
            note: "90 %: 295 kPa to 308 kPa".into(),
        }],
        animation: None,
        animation_caption: String::new(),
        drawings: vec![],
        scene: Some(Scene {
            colours: vec![[255, 0, 255]; cube.len()],
            frames: vec![cube, fallen],
            frame_dt: 0.5,
            ground: 0.0,
            cameras: vec![[[1.0, 0.0, 0.0, 0.1], [0.0, 1.0, 0.0, 0.3], [0.0, 0.0, 1.0, 1.2]]],
        }),
        plots: Vec::new(),
        notes: Vec::new(),
        timings: Vec::new(),
        config_toml: String::new(),
        files: Vec::new(),
    };
    let folder = TempDir::new().unwrap();
    let folder = folder.path();
    std::fs::write(folder.join("index.html"), page.html()).unwrap();

    let text = |page: &str, id: &str| {
        let element = page.split_once(&format!("id=\"{id}\""))?.1;
        element.split_once('>')?.1.split('<').next().map(str::to_owned)
    };
    let after = (0..OPENED)
        .map(|_| run(&browser, folder, &["--dump-dom"]))
        .find(|page| !text(page, "no-player").is_none_or(|text| text.contains("no WebGL")))
        .expect("a browser with WebGL");
    let player = after.split("id=\"player\"").nth(1).and_then(|rest| rest.split('>').next()).unwrap();
    assert!(!player.contains("hidden"), "the player did not start: {after}");
    let clock = text(&after, "clock").unwrap_or_default();
    assert!(clock.contains("of 2") && clock.contains(" s · frame"), "the clock says {clock:?}");
    assert!(after.contains("1000 particles") && after.contains("301 kPa") && after.contains("295 kPa to 308 kPa"));

    let picture = folder.join("page.png");
    let seen = |_| {
        run(&browser, folder, &[&format!("--screenshot={}", picture.display())]);
        magenta(&picture)
    };
    let count = (0..OPENED).map(seen).find(|count| *count > 1000);
    assert!(count.is_some(), "the particles' colour on no picture of the page");
}
