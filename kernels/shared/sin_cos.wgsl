// sin(x + turns pi/2) for a whole number of quarter turns. Twin of src/scalar/sin_cos.rs, with the same coefficients.
// Built-in functions lose all relative precision near their zeros on some drivers.
fn scalar_quarter_turned(x: f32, turns: f32) -> f32 {
    // pi/2 in parts whose products with q are exact
    let q = floor(x * 0.63661977 + 0.5);
    let r = ((x - q * 1.5703125) - q * 0.0004837513) - q * 7.54979e-8;
    let square = r * r;
    var sine = -0.00019510838;
    sine = sine * square + 0.008332131;
    sine = sine * square - 0.16666654;
    sine = sine * (square * r) + r;
    var cosine = 2.4425679e-5;
    cosine = cosine * square - 0.0013887251;
    cosine = cosine * square + 0.041666646;
    cosine = cosine * (square * square) + (1.0 - 0.5 * square);
    let quarter = i32(q) + i32(turns);
    let turned = select(sine, cosine, (quarter & 1) == 1);
    return select(turned, -turned, (quarter & 2) == 2);
}
