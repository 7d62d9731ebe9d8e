//! NumPy's arrays.

use gradreel::io::{Archive, Format, npy};
use gradreel::{DType, ErrorKind, Tensor};

fn wanted(scale: f64) -> Vec<f64> {
    (0..24).map(|i| f64::from(i - 5) * scale).collect()
}

#[test]
fn arrays_of_numpy_are_read_in_row_major_order() {
    let fortran = npy::read("tests/vectors/fortran_f4.npy").unwrap();
    assert_eq!((fortran.dims(), fortran.dtype()), (&[2, 3, 4][..], DType::F32));
    assert_eq!(fortran.to_vec().unwrap(), wanted(0.5));
    let big_endian = npy::read("tests/vectors/big_endian_f8.npy").unwrap();
    assert_eq!(big_endian.slice::<f64>(), wanted(0.25));
    let signed = npy::read("tests/vectors/signed_i8.npy").unwrap();
    assert_eq!(signed.slice::<f64>(), wanted(1.0));
}

#[test]
fn an_npz_lists_its_arrays() {
    let archive = Archive::open("tests/vectors/kinds.npz").unwrap();
    assert_eq!(archive.format(), Format::Npz);
    let list = |name: &str| archive.load(name).unwrap().to_vec().unwrap();
    assert_eq!(list("b1"), [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(list("f2"), [1.5, -2.0, 65504.0]);
    assert_eq!(list("i4"), [1.0, 2147483647.0]);
    assert_eq!(list("u1"), [0.0, 255.0]);
    assert_eq!(list("u4"), [4294967295.0]);
    assert_eq!((list("i8"), archive.load("i8").unwrap().dims().len()), (vec![7.0], 0));
    assert_eq!(archive.load("empty").unwrap().dims(), [0, 3]);
    assert_eq!(archive.load("f2").unwrap().dtype(), DType::F16);
    assert_eq!(archive.load_as("i4", DType::F64).unwrap().slice::<f64>(), [1.0, 2147483647.0]);
    assert_eq!(archive.load_as("i4", DType::F32).unwrap_err().kind(), ErrorKind::Unsupported);
}

#[test]
fn what_is_written_is_what_numpy_writes() {
    // numpy.save(f, numpy.arange(3, dtype='<f4'))
    let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (3,), }";
    let mut wanted = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
    wanted.extend(format!("{header:<117}\n").bytes());
    wanted.extend([0.0f32, 1.0, 2.0].iter().flat_map(|v| v.to_le_bytes()));
    let x = Tensor::from_vec(vec![0.0f32, 1.0, 2.0], [3]);
    assert_eq!(npy::to_bytes(&x).unwrap(), wanted);
    for shape in [vec![], vec![1], vec![0, 4], vec![2, 1, 3]] {
        let x = Tensor::full(2.5, shape, DType::F64);
        let again = npy::from_bytes(&npy::to_bytes(&x).unwrap()).unwrap();
        assert_eq!((again.spec(), again.to_vec().unwrap()), (x.spec(), x.to_vec().unwrap()));
    }
}

#[test]
fn headers_of_python_2_are_read() {
    for (shape, dims) in [("(2L, 3L)", &[2, 3][..]), ("(6L,)", &[6]), ("(1L,2, 3L)", &[1, 2, 3])] {
        let header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.bytes());
        bytes.extend((0..6).flat_map(|i| f64::from(i).to_le_bytes()));
        let x = npy::from_bytes(&bytes).unwrap();
        assert_eq!((x.dims(), x.slice::<f64>()), (dims, &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0][..]));
    }
}

#[test]
fn headers_that_lie_are_refused() {
    let file = |header: &str, data: usize| {
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.bytes());
        bytes.extend(vec![0; data]);
        bytes
    };
    let good = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 2), }";
    npy::from_bytes(&file(good, 16)).unwrap();
    let cases = [
        (file(good, 15), "15 bytes for shape [2, 2]"),
        (file("{'descr': '|O', 'fortran_order': False, 'shape': (2,), }", 16), "|O"),
        (file("{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': (2,), }", 8), "[('a', '<f4')]"),
        (file("{'descr': '<f4', 'fortran_order': False, 'shape': (-1,), }", 4), "descr, fortran_order and shape"),
        (file("{'descr': '<f4', 'shape': (1,), }", 4), "descr, fortran_order and shape"),
        (
            file("{'descr': '<f4', 'fortran_order': False, 'shape': (4294967296, 4294967296, 0), }", 0),
            "bytes for shape",
        ),
        (b"\x93NUMPY\x01\x00\xff\xff".to_vec(), "longer than the file"),
        (b"\x93NUMPY\x09\x00\x00\x00".to_vec(), "version 9"),
    ];
    for (bytes, wanted) in cases {
        let error = npy::from_bytes(&bytes).unwrap_err().to_string();
        assert!(error.contains(wanted), "{error}");
    }
}
