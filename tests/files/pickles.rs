//! What PyTorch programs save besides a plain dict of tensors: every protocol, whole models, keys of other types.

use gradreel::ErrorKind;
use gradreel::io::{Archive, Format};

use crate::build::{int, state, tensor, text, tuple, zip};

/// 1 to 4, as storage 0 holds them here.
fn numbers() -> Vec<u8> {
    [1.0f32, 2.0, 3.0, 4.0].iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn open(pickle: &[u8]) -> gradreel::Result<Archive> {
    Archive::from_bytes(zip(&[("top/data.pkl", pickle), ("top/data/0", &numbers())]))
}

fn list(archive: &Archive, name: &str) -> Vec<f64> {
    archive.load(name).unwrap().to_vec().unwrap()
}

fn names(archive: &Archive) -> Vec<&str> {
    archive.names().collect()
}

/// The value of a tensor of all four numbers.
fn all() -> Vec<u8> {
    tensor(4, 0, &[4], &[1])
}

/// A tensor of four numbers with metadata: pairs of a name and a value.
fn with_metadata(class: &str, pairs: &[(&str, u8)]) -> Vec<u8> {
    let storage = [
        text("storage"),
        format!("ctorch\n{class}\n").into_bytes(),
        text("0"),
        text("cpu"),
        int(if class == "FloatStorage" { 4 } else { 2 }),
    ];
    let pairs = pairs.iter().map(|(name, value)| [text(name), vec![*value], b"s".to_vec()].concat());
    [
        b"ctorch._utils\n_rebuild_tensor_v2\n((".to_vec(),
        storage.concat(),
        b"tQ".to_vec(),
        int(0),
        tuple(&[2]),
        tuple(&[1]),
        b"\x89ccollections\nOrderedDict\n)R}".to_vec(),
        pairs.collect::<Vec<_>>().concat(),
        b"tR".to_vec(),
    ]
    .concat()
}

#[test]
fn the_negative_bit_negates() {
    let archive = open(&state(&with_metadata("FloatStorage", &[("neg", 0x88)]))).unwrap();
    assert_eq!(list(&archive, "w"), [-1.0, -2.0]);
    // in place, too, and in a copy of another type
    assert_eq!(archive.map("w").unwrap().to_vec().unwrap(), [-1.0, -2.0]);
    assert_eq!(archive.load_as("w", gradreel::DType::F64).unwrap().slice::<f64>(), [-1.0, -2.0]);
    let plain = open(&state(&with_metadata("FloatStorage", &[("neg", 0x89), ("conj", 0x89)]))).unwrap();
    assert_eq!(list(&plain, "w"), [1.0, 2.0]);
    for (class, bits, said) in [
        ("ComplexFloatStorage", &[("conj", 0x88)][..], "ComplexFloatStorage"),
        ("FloatStorage", &[("conj", 0x88)], "conjugate bit"),
        ("FloatStorage", &[("zero", 0x88)], "other than its negative bit"),
    ] {
        let error = open(&state(&with_metadata(class, bits))).unwrap().load("w").unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Unsupported);
        assert!(error.to_string().contains(said) && error.to_string().contains("fix: "), "{error}");
    }
}

#[test]
fn keys_of_one_name_are_told_apart_or_refused() {
    // {1: x, "1": y, "z": z}
    let pickle = [&b"\x80\x02}(K\x01"[..], &all(), &text("1"), &all(), &text("z"), &all(), b"u."].concat();
    let archive = open(&pickle).unwrap();
    assert_eq!(names(&archive), ["1", "z"]);
    assert_eq!(list(&archive, "z").len(), 4);
    let error = archive.load("1").unwrap_err().to_string();
    assert!(error.contains("top[1] and top[\"1\"]") && error.contains("fix: "), "{error}");
    assert!(archive.load_all().is_err());
    // {"a.b": x, "a": {"b": y}}, and the same key twice
    let nested = [&b"\x80\x02}("[..], &text("a.b"), &all(), &text("a"), b"}", &text("b"), &all(), b"su."].concat();
    let error = open(&nested).unwrap().load("a.b").unwrap_err().to_string();
    assert!(error.contains("top[\"a.b\"] and top[\"a\"][\"b\"]"), "{error}");
    let twice = [&b"\x80\x02}("[..], &text("w"), &all(), &text("w"), &all(), b"u."].concat();
    assert!(open(&twice).unwrap().load("w").is_err());
    // an empty key, whose path is that of the whole
    let empty = [&b"\x80\x02}("[..], &text(""), &all(), &text("a"), &all(), b"u."].concat();
    assert_eq!(names(&open(&empty).unwrap()), ["", "a"]);
    // {(1, 2): x, (3, 4): y, (1,): z, None: u, True: v}
    let tuples = [
        &b"\x80\x02}(K\x01K\x02\x86"[..],
        &all(),
        b"K\x03K\x04\x86",
        &tensor(4, 1, &[1], &[1]),
        b"K\x01\x85",
        &all(),
        b"N",
        &all(),
        b"\x88",
        &all(),
        b"u.",
    ];
    let archive = open(&tuples.concat()).unwrap();
    assert_eq!(names(&archive), ["(1, 2)", "(1,)", "(3, 4)", "None", "True"]);
    assert_eq!((list(&archive, "(1, 2)").len(), list(&archive, "(3, 4)")), (4, vec![2.0]));
    // constants of one name are both kept
    let constants = open(&[&b"\x80\x02}(K\x01K\x05"[..], &text("1"), b"K\x06u."].concat()).unwrap();
    assert_eq!((&*constants.metadata()["1"], &*constants.metadata()["[\"1\"]"]), ("5", "6"));
}

/// The pickle of {"w": tensor of four numbers} in text, as protocol 0 has it.
const TEXT: &[u8] = b"(dp0\nVw\np1\nctorch._utils\n_rebuild_tensor_v2\np2\n(P('storage', <class 'torch.FloatStorage'>, '0', \
'cpu', 4)\nI0\n(I2\nI2\ntp3\n(I2\nI1\ntp4\nI00\nccollections\nOrderedDict\np5\n(tRp6\ntp7\nRp8\nsVl\\u00e9\np9\nL123L\ns\
S'old\\x21'\nF1.5\nsVbig\nL123456789012345678901234567890L\ns.";

#[test]
fn every_protocol_is_read() {
    let archive = open(TEXT).unwrap();
    assert_eq!((names(&archive), list(&archive, "w")), (vec!["w"], vec![1.0, 2.0, 3.0, 4.0]));
    assert_eq!(archive.load("w").unwrap().dims(), [2, 2]);
    assert_eq!((&*archive.metadata()["l\u{e9}"], &*archive.metadata()["old!"]), ("123", "1.5"));

    let w = [text("w"), all()].concat();
    let beside: [(&str, &[u8]); 12] = [
        ("a frozenset of protocol 4", b"(K\x01K\x02\x91"),
        ("a set", b"\x8f(K\x01\x90"),
        ("a set of protocol 2", b"c__builtin__\nset\n](K\x01K\x02e\x85R"),
        ("bytes of protocol 2", b"c_codecs\nencode\nX\x01\0\0\0aX\x06\0\0\0latin1\x86R"),
        ("bytes of protocol 4", b"\x8e\x02\0\0\0\0\0\0\0ab"),
        ("a bytearray of protocol 5", b"\x96\x02\0\0\0\0\0\0\0ab"),
        ("a class", b"ctorch\nfloat32\n"),
        ("a large integer", b"\x8a\x09\0\0\0\0\0\0\0\0\x01"),
        ("a dropped mark", b"(0K\x01"),
        ("a complex number", b"c__builtin__\ncomplex\nG\0\0\0\0\0\0\0\0G\0\0\0\0\0\0\0\0\x86R"),
        ("a class by its number", b"\x82\x01"),
        ("an empty frozenset", b"(\x91"),
    ];
    for (what, value) in beside {
        for protocol in 0..=5u8 {
            let pickle = [&b"\x80"[..], &[protocol], b"}(", &w, &text("other"), value, b"u."].concat();
            let archive = open(&pickle).unwrap_or_else(|e| panic!("{what}: {e}"));
            assert_eq!(list(&archive, "w"), [1.0, 2.0, 3.0, 4.0], "{what}");
            archive.load_all().unwrap_or_else(|e| panic!("{what}: {e}"));
        }
    }
    // objects stay what they are, and harm nobody else
    for object in [&b"(ios\nsystem\n"[..], b"(cos\nsystem\nK\x01o", b"\x97\x98", b"cos\nsystem\n)}\x92"] {
        let archive = open(&[&b"\x80\x05}("[..], &w, &text("other"), object, b"u."].concat()).unwrap();
        assert_eq!(list(&archive, "w").len(), 4);
        let error = archive.load("other").unwrap_err().to_string();
        assert!(error.contains("never made") && error.contains("state_dict()"), "{error}");
    }
}

/// A module of PyTorch as a pickle has it: parameters, buffers, modules.
fn module(parameters: &[u8], buffers: &[u8], modules: &[u8]) -> Vec<u8> {
    [
        &b"ctorch.nn.modules.linear\nLinear\n)\x81}("[..],
        &text("training"),
        b"\x88",
        &text("_parameters"),
        b"}(",
        parameters,
        b"u",
        &text("_buffers"),
        b"ccollections\nOrderedDict\n)R(",
        buffers,
        b"u",
        &text("_non_persistent_buffers_set"),
        b"c__builtin__\nset\n](",
        &text("passing"),
        b"e\x85R",
        &text("_backward_hooks"),
        b"ccollections\nOrderedDict\n)R",
        &text("_modules"),
        b"}(",
        modules,
        b"uub",
    ]
    .concat()
}

#[test]
fn of_a_whole_model_the_state_dict_is_read() {
    let inner = module(&[text("weight"), all(), text("bias"), b"N".to_vec()].concat(), &[], &[]);
    let buffers = [text("mean"), tensor(4, 1, &[1], &[1]), text("passing"), all()].concat();
    let outer = module(&[], &buffers, &[text("0"), inner.clone(), text("1"), b"N".to_vec()].concat());
    let archive = open(&[&b"\x80\x02"[..], &outer, b"."].concat()).unwrap();
    assert_eq!(names(&archive), ["0.weight", "mean"]);
    assert_eq!((list(&archive, "0.weight"), list(&archive, "mean")), (vec![1.0, 2.0, 3.0, 4.0], vec![2.0]));
    archive.load_all().unwrap();
    // within a dict, as trainers save it, and as the state of an object of another kind
    let within = open(&[&b"\x80\x02}"[..], &text("model"), &outer, b"s."].concat()).unwrap();
    assert_eq!(names(&within), ["model.0.weight", "model.mean"]);
    let trainer =
        [&b"\x80\x02cmy.code\nTrainer\n)\x81}("[..], &text("net"), &inner, &text("step"), b"K\x07ub."].concat();
    let trainer = open(&trainer).unwrap();
    assert_eq!((names(&trainer), &*trainer.metadata()["step"]), (vec!["net.weight"], "7"));
}

#[test]
fn kinds_of_dictionaries_are_dictionaries() {
    let fill = [&b"("[..], &text("w"), &all(), b"u"].concat();
    for made in [
        &b"ccollections\ndefaultdict\nc__builtin__\ndict\n\x85R"[..],
        b"ccollections\ndefaultdict\n)R",
        b"ccollections\nOrderedDict\n)R",
        b"cmy.code\nAttributes\n)\x81",
        b"cmy.code\nAttributes\n)}\x92",
    ] {
        let attributes = [&b"}"[..], &text("_metadata"), b"}sb"].concat();
        for after in [&b""[..], &attributes] {
            let archive = open(&[&b"\x80\x04"[..], made, &fill, after, b"."].concat()).unwrap();
            assert_eq!((names(&archive), list(&archive, "w").len()), (vec!["w"], 4), "{}", made.escape_ascii());
        }
    }
    // an object at the top that nothing can be read of is one error, with a name for it
    for top in [&b"cmy.code\nModel\n)\x81."[..], b"cmy.code\nModel\n)R.", b"K\x01.", b"cmy.code\nModel\n."] {
        let error = open(&[b"\x80\x02", top].concat()).unwrap_err();
        let told = error.to_string();
        assert!(told.contains("holds no tensors by name") && told.contains("model.state_dict()"), "{told}");
        assert!(error.kind() == ErrorKind::Input && !told.contains("damaged"), "{told}");
    }
}

/// The old container: the values, then the storages by key with their numbers of elements and bytes.
fn old(values: &[u8], storages: &[(&str, i64, &[u8])]) -> Vec<u8> {
    let mut file = b"\x80\x02\x8a\x0al\xfc\x9cF\xf9 j\xa8P\x19.\x80\x02M\xe9\x03.\x80\x02}".to_vec();
    file.extend([text("little_endian"), b"\x88s.\x80\x02".to_vec(), values.to_vec(), b".\x80\x02](".to_vec()].concat());
    storages.iter().for_each(|(key, ..)| file.extend(text(key)));
    file.extend(b"e.");
    for (_, count, bytes) in storages {
        file.extend(count.to_le_bytes());
        file.extend(*bytes);
    }
    file
}

/// A vector in a storage of this class and key.
fn vector(class: &str, key: &str, len: i64) -> Vec<u8> {
    let storage =
        [text("storage"), format!("ctorch\n{class}\n").into_bytes(), text(key), text("cpu"), int(len)].concat();
    [
        b"ctorch._utils\n_rebuild_tensor_v2\n((".to_vec(),
        storage,
        b"NtQ".to_vec(),
        int(0),
        tuple(&[len]),
        tuple(&[1]),
        b"\x89ccollections\nOrderedDict\n)RtR".to_vec(),
    ]
    .concat()
}

#[test]
fn a_storage_that_is_not_read_leaves_the_others_of_the_old_container() {
    let values = |class: &str| {
        let entries = [text("a"), vector("FloatStorage", "8", 4), text("c"), vector(class, "9", 2), text("w")].concat();
        [&b"}("[..], &entries, &vector("FloatStorage", "10", 4), b"u"].concat()
    };
    let storages = [("8", 4, &numbers()[..]), ("9", 2, &[0; 16]), ("10", 4, &numbers())];
    let archive = Archive::from_bytes(old(&values("ComplexFloatStorage"), &storages)).unwrap();
    assert_eq!(archive.format(), Format::TorchLegacy);
    assert_eq!((list(&archive, "a"), list(&archive, "w")), (vec![1.0, 2.0, 3.0, 4.0], vec![1.0, 2.0, 3.0, 4.0]));
    let error = archive.load("c").unwrap_err();
    let told = error.to_string();
    assert!(told.contains("ComplexFloatStorage") && told.contains("view_as_real"), "{told}");
    assert_eq!(error.kind(), ErrorKind::Unsupported);
    // of one whose size nobody knows, what lies before it
    let archive = Archive::from_bytes(old(&values("StrangeStorage"), &storages)).unwrap();
    assert_eq!(list(&archive, "a").len(), 4);
    for name in ["c", "w"] {
        let told = archive.load(name).unwrap_err().to_string();
        assert!(told.contains("StrangeStorage") && told.contains("fix: "), "{told}");
    }
}

#[test]
fn the_old_container_holds_models_and_text_pickles_too() {
    let module = module(&[text("weight"), vector("FloatStorage", "8", 4)].concat(), &[], &[]);
    // the class by a reference with its source
    let class =
        [&b"("[..], &text("module"), b"cmy.code\nNet\n", &text("net.py"), &text("class Net: ..."), b"tQ"].concat();
    let plain = b"ctorch.nn.modules.linear\nLinear\n";
    let with_source = [&class, &module[plain.len()..]].concat();
    for values in [module.clone(), with_source] {
        let archive = Archive::from_bytes(old(&values, &[("8", 4, &numbers())])).unwrap();
        assert_eq!((names(&archive), list(&archive, "weight").len()), (vec!["weight"], 4));
    }
    let values: Vec<u8> =
        String::from_utf8(TEXT.to_vec()).unwrap().replace("'0'", "'8'").replace("4)", "4, None)").into();
    let head = b"L119547037146038801333356L\n.I1001\n.(dVlittle_endian\nI01\ns.";
    let mut file = [&head[..], &values, b"(lV8\na."].concat();
    file.extend(4i64.to_le_bytes());
    file.extend(numbers());
    let archive = Archive::from_bytes(file).unwrap();
    assert_eq!((archive.format(), list(&archive, "w")), (Format::TorchLegacy, vec![1.0, 2.0, 3.0, 4.0]));
}
