//! Output of view synthesis: a clip of one frame, pictures of all views, and a page.

use gradreel::io::TensorFile;
use gradreel::{Result, Tensor};
use serde_json::json;

use super::animation::{Picture, gif};
use super::page::Page;
use super::png_file::png;
use crate::runtime::run_folder::RunFolder;
use crate::views::Ring;

/// The page; it is written last.
pub const PAGE: &str = "index.html";

/// Duration of the animation around the object \[s\].
const AROUND: f64 = 2.5;

/// Synthesized views of one picture.
pub struct Synthesis<'a> {
    /// Name of the picture.
    pub title: &'a str,
    /// The cameras of the views.
    pub ring: &'a Ring,
    /// The picture as given to the model.
    pub input: &'a Picture,
    /// One square picture per camera, all of the same size.
    pub views: &'a [Picture],
    /// The decoded latents, `[1, views, latent, w, w]`.
    pub latents: &'a Tensor,
    /// Further notes on the page: name and text.
    pub notes: Vec<(String, String)>,
    /// The settings of the run as TOML.
    pub settings: &'a str,
}

/// Writes all files. The folder is a clip that can be read by [`crate::video::inspect()`] and
/// [`crate::video::Clip::open`]: `data/r_{view}_0.png` with masks, and the cameras in `all_data.json`, with a unit
/// of the model as a metre.
///
/// # Errors
/// Errors of encoding and writing.
///
/// # Panics
/// If the number of pictures is not that of the cameras, or a picture is not square.
#[track_caller]
pub fn publish(folder: &RunFolder, found: &Synthesis<'_>) -> Result<()> {
    let Synthesis { ring, views, .. } = found;
    assert_eq!(views.len(), ring.views, "a picture for each camera");
    let mut list = Vec::new();
    for (number, view) in views.iter().enumerate() {
        assert_eq!(view.width, view.height, "views are square");
        let bytes = png(view)?;
        folder.write(&format!("data/r_{number}_0.png"), &bytes)?;
        // an object on white is its own mask
        folder.write(&format!("data/m_{number}_0.png"), &bytes)?;
        let camera = ring.camera(number, view.width);
        list.push(json!({
            "file_path": format!("./data/r_{number}_0.png"),
            "time": 0.0,
            "c2w": camera.c2w,
            "intrinsic": [[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]],
        }));
    }
    let list = serde_json::to_vec_pretty(&list).expect("numbers and text");
    folder.write("all_data.json", &list)?;
    folder.write("input.png", &png(found.input)?)?;
    folder.write("views.png", &sheet(views, 1)?)?;
    let rate = views.len() as f64 / AROUND;
    folder.write("around.gif", &gif(views, rate)?)?;
    let mut latents = TensorFile::default();
    latents.tensors.insert("latents".into(), found.latents.clone());
    folder.write("latents.safetensors", &latents.to_bytes()?)?;
    let beside: Vec<Picture> = views.iter().map(|view| found.input.beside(view)).collect();
    let page = page(found, &gif(&beside, rate)?);
    folder.write(PAGE, page.as_bytes())
}

fn page(found: &Synthesis<'_>, animation: &[u8]) -> String {
    let ring = found.ring;
    let mut notes = vec![
        (
            "Cameras".into(),
            format!(
                "{} around the object, {:.1}° apart, {:.1}° above the ground; view 0 is where the picture was taken",
                ring.views,
                360.0 / ring.views as f64,
                ring.elevation.to_degrees()
            ),
        ),
        (
            "Scale".into(),
            format!("unknown: cameras are put {} m away, so that the object fits a cube of one metre", ring.distance),
        ),
        ("What the picture does not show".into(), "is a guess of the model; other seeds guess otherwise".into()),
    ];
    notes.extend(found.notes.iter().cloned());
    let files = [
        ("views.png", "all views on one sheet, row by row"),
        ("around.gif", "once around the object"),
        ("input.png", "the picture as the model saw it"),
        ("data/", "one PNG file a view, as a clip of one frame"),
        ("all_data.json", "the cameras of that clip; look at it with `gradreel check`"),
        ("latents.safetensors", "the latents that were decoded"),
        ("settings.toml", "what was asked for"),
        ("state.safetensors", "where --resume goes on"),
    ];
    Page {
        title: found.title,
        subtitle: format!("{} views synthesized from one picture", ring.views),
        headlines: vec![],
        animation: Some(animation),
        animation_caption: "Left: the picture. Right: once around the object.".into(),
        drawings: vec![],
        scene: None,
        plots: vec![],
        notes,
        timings: vec![],
        config_toml: found.settings.to_owned(),
        files: files.map(|(link, what)| (link.to_owned(), what.to_owned())).to_vec(),
    }
    .html()
}

/// Pictures arranged on a nearly square sheet as PNG, each pixel enlarged to `enlarged²` pixels.
///
/// # Errors
/// As [`png()`].
pub fn sheet(pictures: &[Picture], enlarged: usize) -> Result<Vec<u8>> {
    let columns = (1..=pictures.len()).find(|columns| columns * columns >= pictures.len()).unwrap_or(1);
    let sheet = Picture::grid(columns, pictures);
    let (width, height) = (sheet.width * enlarged, sheet.height * enlarged);
    let pixels = sheet.rgb.as_chunks::<3>().0;
    let pixel = |i: usize| pixels[i / width / enlarged * sheet.width + i % width / enlarged];
    let rgb = (0..width * height).flat_map(pixel).collect();
    png(&Picture { width, height, rgb })
}

/// Converts colour planes in −1..1, `[3, h, w]` or `[1, 3, h, w]`, to a picture.
///
/// # Errors
/// If a value is not finite.
///
/// # Panics
/// If the shape is different.
#[track_caller]
pub fn picture_of(planes: &Tensor) -> Result<Picture> {
    let ([3, height, width] | [1, 3, height, width]) = planes.dims()[..] else {
        panic!("pictures are [3, h, w], not {}", planes.shape())
    };
    let (values, area) = (planes.to_vec()?, height * width);
    let unit = |i: usize| ((values[i % 3 * area + i / 3] + 1.0) / 2.0) as f32;
    Picture::from_unit(width, height, &(0..3 * area).map(unit).collect::<Vec<f32>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_become_pixels() {
        let planes = Tensor::from_vec(vec![-1.0f32, 1.0, 0.0, 0.5, 2.0, -3.0], [3, 1, 2]);
        let picture = picture_of(&planes).unwrap();
        assert_eq!((picture.width, picture.height), (2, 1));
        assert_eq!(picture.rgb, [0, 128, 255, 255, 191, 0]);
        assert!(picture_of(&Tensor::full(f64::NAN, [1, 3, 2, 2], gradreel::DType::F32)).is_err());
    }

    #[test]
    fn a_sheet_repeats_its_pixels() {
        let dot = |v: u8| Picture { width: 1, height: 1, rgb: vec![v; 3] };
        let bytes = sheet(&[dot(10), dot(20), dot(30)], 2).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.width, info.height), (4, 4));
        let rows: Vec<Vec<u8>> = pixels.chunks(12).map(|row| row.iter().copied().step_by(3).collect()).collect();
        assert_eq!(rows, [[10, 10, 20, 20], [10, 10, 20, 20], [30, 30, 255, 255], [30, 30, 255, 255]]);
    }
}
