//! A folder of meshes: samples follow from their keys, the split holds, and files that cannot be used are told.

use std::collections::BTreeSet;

use crate::views::Ring;
use crate::views::objects::{FolderSettings, MeshFolder, Sample, SampleSettings};
use gradreel::Key;

use super::mesh_files::{cube, cube_glb, obj};
use super::meshes::Folder;

fn open(folder: &Folder, settings: FolderSettings) -> MeshFolder {
    MeshFolder::open(folder.root(), settings, &|| {}).unwrap()
}

/// Boxes of different shapes and colours.
fn boxes(folder: &Folder, numbers: std::ops::Range<usize>) {
    for number in numbers {
        let mut model = cube();
        model.uvs.clear();
        let share = number as f32 / 64.0;
        model.places.iter_mut().for_each(|x| x[0] *= 0.3 + share);
        model.colours = vec![[share, 0.5, 0.7 - 0.5 * share]; 24];
        folder.write(&format!("kind {}/box_{number}.obj", number % 3), obj(&model, ""));
    }
}

fn names<'a>(files: impl Iterator<Item = &'a crate::views::objects::MeshFile>) -> BTreeSet<String> {
    files.map(|file| file.name.clone()).collect()
}

#[test]
fn a_sample_follows_from_its_key() {
    let folder = Folder::new();
    boxes(&folder, 0..12);
    let ring = Ring::published(4);
    let settings = SampleSettings { rays: 1, ..SampleSettings::default() };
    let roomy = open(&folder, FolderSettings::default());
    // no mesh stays in memory, or one
    let scarce = open(&folder, FolderSettings { memory: 0, ..FolderSettings::default() });
    let single = open(&folder, FolderSettings { memory: 3000, ..FolderSettings::default() });
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let draw = |meshes: &MeshFolder, key: Key| {
        Sample::of(&meshes.object(Sample::object_key(key)).unwrap(), key, &ring, 32, &settings)
    };
    let mut all = Vec::new();
    for key in (0..12).map(Key::new) {
        let sample = draw(&roomy, key);
        assert!(sample == alone.install(|| draw(&scarce, key)) && sample == draw(&single, key));
        assert!(sample.seen(&ring).is_some());
        assert!(all.iter().all(|other| *other != sample), "no two alike");
        all.push(sample);
    }
    let shown = |number: usize| roomy.unseen_object(number, Key::new(1)).unwrap().half();
    let count = roomy.unseen().len();
    assert!(shown(0) == shown(count), "they come again");
    assert!((1..count).all(|number| shown(number) != shown(0)), "after all others");
}

#[test]
fn the_split_is_stable_and_nothing_is_on_both_sides() {
    let folder = Folder::new();
    boxes(&folder, 0..40);
    let settings = FolderSettings { held_out: 0.25, ..FolderSettings::default() };
    let first = open(&folder, settings);
    let (trained, unseen) = (names(first.trained()), names(first.unseen()));
    assert!(first.is_divided() && trained.is_disjoint(&unseen) && trained.len() + unseen.len() == 40);
    assert!((4..=16).contains(&unseen.len()), "{unseen:?}");
    let again = open(&folder, settings);
    assert!(again.mark() == first.mark() && names(again.unseen()) == unseen);
    boxes(&folder, 40..60);
    // the same object in another format is on the same side
    folder.write("kind 1/box_1.glb", cube_glb());
    let more = open(&folder, settings);
    assert!(more.mark() != first.mark());
    assert!(names(more.trained()).is_superset(&trained) && names(more.unseen()).is_superset(&unseen));
    let side = |name: &str| more.files().iter().find(|file| file.name == name).unwrap().trained;
    assert_eq!(side("kind 1/box_1.glb"), side("kind 1/box_1.obj"));

    let of = |numbers, held_out| {
        let folder = Folder::new();
        boxes(&folder, numbers);
        let meshes = open(&folder, FolderSettings { held_out, ..settings });
        (meshes.trained().len(), meshes.unseen().len(), meshes.is_divided())
    };
    assert_eq!(of(0..2, 1e-9), (1, 1, true));
    assert_eq!(of(0..2, 0.999_999), (1, 1, true));
    assert_eq!(of(0..1, 0.5), (1, 1, false));
    assert_eq!(of(0..3, 0.0), (3, 3, false));
    assert_eq!(of(0..3, 1.0), (0, 3, true));
}

#[test]
fn files_that_cannot_be_used_are_left_out_and_told() {
    let folder = Folder::new();
    let refused = || MeshFolder::open(folder.root(), FolderSettings::default(), &|| {}).err().unwrap().to_string();
    assert!(refused().contains("no meshes in the folder"), "{}", refused());
    folder.write("a/broken.OBJ", "v 0 0 0\nf 1 2 3\n");
    folder.write("a/empty.gltf", "");
    folder.write("a/readme.txt", "no mesh");
    folder.write(".hidden/cube.glb", cube_glb());
    assert!(
        refused().contains("no mesh in the folder can be used") && refused().contains("broken.OBJ"),
        "{}",
        refused()
    );
    folder.write("b/cube.GLB", cube_glb());
    let meshes = open(&folder, FolderSettings::default());
    let told: Vec<(&str, Option<String>)> = meshes.files().iter().map(|file| (&*file.name, file.why())).collect();
    assert_eq!(told.iter().map(|(name, _)| *name).collect::<Vec<_>>(), ["a/broken.OBJ", "a/empty.gltf", "b/cube.GLB"]);
    assert!(told[0].1.as_ref().unwrap().contains("line 2") && told[1].1.is_some() && told[2].1.is_none());
    let missing = MeshFolder::open(&folder.root().join("nowhere"), FolderSettings::default(), &|| {}).err().unwrap();
    assert!(missing.to_string().contains("nowhere"));
}
