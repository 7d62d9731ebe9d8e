//! How the parts are used, and what comes of it.

#[test]
fn a_quantity_is_shown_with_its_prefix_and_interval() {
    use crate::report::quantity::Quantity;

    let young = Quantity {
        name: "young".into(),
        label: "Young's modulus".into(),
        symbol: "E".into(),
        unit: "Pa".into(),
        value: 301_234.0,
        start: Some(1e6),
        source: "fitted".into(),
        interval_90: Some([295_000.0, 308_000.0]),
        determined: Some(true),
    };
    assert_eq!(young.readable(), "301 kPa");
    assert_eq!(young.readable_interval().as_deref(), Some("295 kPa to 308 kPa"));
}

#[test]
fn a_number_of_a_message_is_short() {
    use crate::report::quantity::compact;

    assert_eq!([0.45, -1e5, 1e300, 2.5e-7, 0.0].map(compact), ["0.45", "-100000", "1e300", "2.5e-7", "0"]);
}

#[test]
fn a_number_of_a_result_has_three_digits() {
    use crate::report::quantity::readable;

    assert_eq!(readable(301_234.0, "Pa"), "301 kPa");
    assert_eq!(readable(5.236e-4, "kg"), "5.24e-4 kg");
}

#[test]
fn bytes_are_encoded() {
    use crate::report::base64::encode;
    assert_eq!(encode(b"tape"), "dGFwZQ==");
}

#[test]
fn padding_is_optional_and_other_text_refused() {
    use crate::report::base64::decode;
    assert_eq!(decode("dGFwZQ==").as_deref(), Some(&b"tape"[..]));
    assert_eq!(decode("dGFwZQ").as_deref(), Some(&b"tape"[..]));
    assert_eq!(decode("dGF?"), None);
}
