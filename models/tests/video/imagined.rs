//! Which views are imagined: said by `clip.toml` or by the caller.

use gradreel_models::video::{OpenOptions, inspect};

use super::builder::{Builder, has};

#[test]
fn the_side_file_names_imagined_views() {
    let builder = Builder::square(&[0, 1, 4], 2);
    assert_eq!(builder.open().unwrap().imagined, [false; 3]);
    std::fs::write(builder.root.join("clip.toml"), "imagined = [1, 4]").unwrap();
    let clip = builder.open().unwrap();
    assert_eq!(clip.imagined, [false, true, true]);
    assert_eq!(clip.scaled(2).imagined, clip.imagined);
    let text = inspect(&builder.root).unwrap().to_string();
    assert_eq!(text.matches(", imagined").count(), 2, "{text}");
    // of those in use
    let some = OpenOptions { cameras: Some(vec![4, 0]), ..OpenOptions::default() };
    assert_eq!(builder.open_with(&some).unwrap().imagined, [true, false]);
    let none = OpenOptions { cameras: Some(vec![4, 1]), ..OpenOptions::default() };
    has(&builder.open_with(&none).unwrap_err().to_string(), &["no view of the clip is real", "4, 1", "--cameras"]);
    std::fs::write(builder.root.join("clip.toml"), "imagined = [2]").unwrap();
    has(&builder.open().unwrap_err().to_string(), &["clip.toml", "camera 2", "0, 1, 4"]);
}

#[test]
fn the_caller_may_know_better() {
    let mut clip = Builder::square(&[0, 1, 4], 2).open().unwrap();
    clip.imagine(&[4]).unwrap();
    assert_eq!(clip.imagined, [false, false, true]);
    has(&clip.imagine(&[7]).unwrap_err().to_string(), &["camera 7", "0, 1, 4"]);
    has(&clip.imagine(&[0, 1, 4]).unwrap_err().to_string(), &["no view of the clip is real"]);
    assert_eq!(clip.imagined, [false, false, true]);
    clip.imagine(&[]).unwrap();
    assert_eq!(clip.imagined, [false; 3]);
}
