//! Checkpoints that lie. Each is refused with an error that says what was found.

use gradreel::ErrorKind;
use gradreel::io::Archive;

use crate::build::{Claim, checkpoint, claimed, state, tensor, text, zip};

/// The error for a file that is refused at once, or when everything is loaded.
fn refusal(bytes: Vec<u8>) -> String {
    match Archive::from_bytes(bytes).and_then(|archive| archive.load_all()) {
        Ok(file) => panic!("accepted: {:?}", file.tensors),
        Err(error) => {
            assert!(matches!(error.kind(), ErrorKind::Input | ErrorKind::Unsupported), "{error:?}");
            error.to_string()
        }
    }
}

fn check(cases: Vec<(Vec<u8>, &str)>) {
    for (bytes, wanted) in cases {
        let error = refusal(bytes);
        assert!(error.contains(wanted), "{error}\ndoes not say: {wanted}");
    }
}

#[test]
fn tensors_that_do_not_fit_their_storage() {
    Archive::from_bytes(checkpoint(&state(&tensor(4, 0, &[2, 2], &[2, 1])))).unwrap().load_all().unwrap();
    Archive::from_bytes(checkpoint(&state(&tensor(4, 3, &[], &[])))).unwrap().load_all().unwrap();
    let view = |offset, sizes: &[i64], strides: &[i64]| checkpoint(&state(&tensor(4, offset, sizes, strides)));
    check(vec![
        (checkpoint(&state(&tensor(5, 0, &[4], &[1]))), "5 elements of 4 bytes"),
        (checkpoint(&state(&tensor(1 << 62, 0, &[4], &[1]))), "top/data/0"),
        (view(1, &[4], &[1]), "beyond its storage"),
        (view(0, &[2, 2], &[3, 1]), "beyond its storage"),
        (view(4, &[], &[]), "beyond its storage"),
        (view(-1, &[4], &[1]), "-1 for a size, stride, offset or length"),
        (view(3, &[4], &[-1]), "-1 for a size, stride, offset or length"),
        (view(0, &[-4], &[1]), "-4 for a size"),
        (view(i64::MAX, &[2], &[1]), "beyond its storage"),
        (view(1, &[3, 3], &[i64::MAX, i64::MAX]), "beyond its storage"),
        (view(0, &[1 << 40, 1 << 40], &[0, 0]), "beyond memory"),
        (view(0, &[0, 1 << 40, 1 << 40], &[0, 0, 0]), "beyond memory"),
        (view(0, &[1 << 33], &[0]), "repeats its storage"),
        (view(0, &[2, 2], &[1]), "2 sizes with 1 strides"),
        (view(0, &[1; 65], &[0; 65]), "65 axes"),
        (zip(&[("top/data.pkl", &state(&tensor(4, 0, &[4], &[1])))]), "top/data/0"),
    ]);
}

#[test]
fn pickles_that_do_more_than_build_values() {
    let pickle = |body: &[u8]| checkpoint(&[b"\x80\x02", body].concat());
    let deep =
        [b"}".to_vec(), [text("a"), b"}".to_vec()].concat().repeat(100), b"s".repeat(100), b".".to_vec()].concat();
    // each dictionary holds the last one twice
    let mut doubling = b"}q\x00".to_vec();
    for i in 0..60u8 {
        doubling.extend([&b"}q"[..], &[i + 1], b"(", &text("a"), b"h", &[i], &text("b"), b"h", &[i], b"u"].concat());
    }
    doubling.push(b'.');
    let cycle = [&b"}q\x00"[..], &text("a"), b"h\x00s."].concat();
    let copies =
        [&b"]q\x00("[..], &b"))\x86".repeat(2000), b"e0", &b"ccollections\nOrderedDict\nh\x00\x85R".repeat(2000), b"."]
            .concat();
    check(vec![
        (pickle(b"(ios\nsystem\n."), "never made"),
        (pickle(b"Psomething\n."), "no storage"),
        (pickle(b"P('storage', <class 'torch.FloatStorage'>, '0', 'cpu', -6)\n."), "-6 for a size"),
        (pickle(b"P('storage', <class 'torch.FloatStorage'>, '0', 'cpu', 6, ('1', 4, 3))\n."), "beyond its storage"),
        (pickle(b"\x82\x01."), "copyreg.extension"),
        (pickle(b"\xff."), "the opcode 0xff"),
        (pickle(b"\x98."), "empty stack"),
        (pickle(b"(o."), "empty stack"),
        (pickle(b"(\x98."), "empty stack"),
        (pickle(b"S'open\n."), "without its quotes"),
        (pickle(b"Ifour\n."), "a number that is none"),
        (pickle(b"X\xff\xff\xff\x7fa."), "before the pickle's own"),
        (pickle(b"\x8d\xff\xff\xff\xff\xff\xff\xff\xffa."), "before the pickle's own"),
        (pickle(b"}"), "before the pickle's own"),
        (pickle(b"."), "empty stack"),
        (pickle(b"}(00."), "empty stack"),
        (pickle(b"h\x07."), "never kept"),
        (pickle(b"t."), "never began"),
        (pickle(b"}(K\x01u."), "a key without a value"),
        (pickle(b"K\x01K\x02R."), "a call of an int"),
        (pickle(b"K\x01Q."), "no storage"),
        (pickle(b"cos\xff\nsystem\n."), "not UTF-8"),
        (pickle(b"\x80\x09}."), "protocol 9"),
        (pickle(&b"(".repeat(5000)), "nested too deeply"),
        (pickle(&deep), "nested too deeply"),
        (pickle(&cycle), "nested too deeply"),
        (pickle(&doubling), "repeats itself"),
        (pickle(&copies), "repeat each other"),
    ]);
}

#[test]
fn calls_within_calls_need_no_stack() {
    let call = b"ctorch._tensor\n_rebuild_from_type_v2\nN";
    let levels = 100_000;
    let pickle =
        [&b"\x80\x02}"[..], &text("w"), b"ctorch._tensor\n_rebuild_from_type_v2\n", &call.repeat(levels), b")"]
            .concat();
    let pickle = [&pickle[..], &b"\x87".repeat(levels), b"Rs."].concat();
    assert!(refusal(checkpoint(&pickle)).contains("never made"));
}

#[test]
fn archives_whose_directory_lies() {
    let pickle: &'static [u8] = state(&tensor(4, 0, &[4], &[1])).leak();
    let entries = || vec![Claim::new("top/data.pkl", pickle), Claim::new("top/data/0", &[0; 16])];
    Archive::from_bytes(claimed(&entries())).unwrap();
    let with = |change: &dyn Fn(&mut Vec<Claim<'static>>)| {
        let mut entries = entries();
        change(&mut entries);
        claimed(&entries)
    };
    let good = claimed(&entries());
    let cut = good[..good.len() - 30].to_vec();
    let mut many = good.clone();
    let end = many.len();
    many[end - 12..end - 10].copy_from_slice(&u16::MAX.to_le_bytes());
    let mut outside = good.clone();
    outside[end - 6..end - 2].copy_from_slice(&(u32::MAX - 1).to_le_bytes());
    check(vec![
        (with(&|e| e[1].method = 8), "method 8"),
        (with(&|e| e[1].flags = 1), "encrypted"),
        (with(&|e| e[1].size = Some(1 << 30)), "outside of the file"),
        (with(&|e| e[0].size = Some(pickle.len() as u32 + 40)), "overlaps top/data.pkl"),
        (with(&|e| e.push(Claim { same_place_as: Some(1), ..Claim::new("top/data/1", &[0; 16]) })), "overlaps"),
        (with(&|e| e.push(Claim::new("top/data/0", &[0; 16]))), "two entries of one name"),
        (with(&|e| e.push(Claim::new("other/data.pkl", pickle))), "two checkpoints"),
        (with(&|e| e.push(Claim::new("top/byteorder", b"big"))), "not little-endian"),
        (with(&|e| e[1].size = Some(u32::MAX)), "without its 64-bit fields"),
        (cut, "no ZIP directory"),
        (many, "does not fit the file"),
        (outside, "does not fit the file"),
        (zip(&[("readme.txt", b"hello")]), "readme.txt"),
    ]);
}

#[test]
fn old_containers_that_are_cut_or_forged() {
    let good = std::fs::read("tests/vectors/tiny_legacy_format.ckpt").unwrap();
    let cut = good[..good.len() - 5].to_vec();
    check(vec![
        (cut, "the storages of the checkpoint are damaged"),
        (b"\x80\x02}.".to_vec(), "magic number"),
        (b"\x80\x02}q".to_vec(), "before the pickle's own"),
        (b"\x80\x04cos\nsystem\n(X\x02\x00\x00\x00lstR.".to_vec(), "magic number"),
    ]);
    // every cut is an error, wherever it is
    for len in (0..good.len()).step_by(7) {
        refusal(good[..len].to_vec());
    }
    let zip = std::fs::read("tests/vectors/tiny_lightning.ckpt").unwrap();
    for len in (0..zip.len()).step_by(13) {
        refusal(zip[..len].to_vec());
    }
}
