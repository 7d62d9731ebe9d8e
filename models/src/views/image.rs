//! Preparation of a masked picture as model input: a square on white, in −1..1.

use gradreel::{Error, ErrorKind, Result, Tape, Tensor, Var};

use super::Bicubic;

/// Prepares an RGBA picture of `height` rows, whose alpha is the foreground mask: `[1, 3, size, size]` in −1..1.
///
/// With `crop`, the foreground's bounding box is cut out, scaled to a longer side of `crop` pixels and centred,
/// which discards the object's position. Otherwise the whole picture is centred in a square and scaled.
///
/// # Errors
/// [`ErrorKind::Input`] if the bytes do not fill the rows, the foreground is empty, or a size is 0.
pub fn prepare(rgba: &[u8], height: usize, size: usize, crop: Option<usize>) -> Result<Tensor> {
    let refuse = |what: &str, found: String| Error::new(ErrorKind::Input, what.to_owned()).found(found);
    if height == 0 || rgba.is_empty() || !rgba.len().is_multiple_of(4 * height) || size == 0 || crop == Some(0) {
        let found = format!("{} bytes, {height} rows, size {size}, crop {crop:?}", rgba.len());
        return Err(refuse("not a picture", found).wanted("four bytes for each pixel, sizes above 0"));
    }
    let whole = Picture { width: rgba.len() / 4 / height, height, rgba: rgba.to_vec() };
    let placed = match crop {
        Some(crop) => {
            let [left, top, right, bottom] = whole.foreground().ok_or_else(|| {
                refuse("the picture has no foreground", "an alpha channel of zeros".into())
                    .fix("give a picture whose alpha channel marks the object")
            })?;
            let part = whole.cut(left, top, right - left, bottom - top);
            let scale = crop as f64 / part.width.max(part.height) as f64;
            let fit = |side: usize| ((side as f64 * scale) as usize).max(1);
            part.resize(fit(part.width), fit(part.height))?.centred(size)
        }
        None => whole.centred(whole.width.max(whole.height)).resize(size, size)?,
    };
    let mut values = vec![0.0f32; 3 * size * size];
    for (i, pixel) in placed.rgba.chunks_exact(4).enumerate() {
        let alpha = f32::from(pixel[3]) / 255.0;
        for channel in 0..3 {
            let on_white = f32::from(pixel[channel]) / 255.0 * alpha + (1.0 - alpha);
            values[channel * size * size + i] = 2.0 * on_white - 1.0;
        }
    }
    Ok(Tensor::from_vec(values, [1, 3, size, size]))
}

struct Picture {
    width: usize,
    height: usize,
    rgba: Vec<u8>,
}

impl Picture {
    /// Left, top, right and bottom of the pixels with nonzero alpha. The last row and column are excluded, as in
    /// the published preparation.
    fn foreground(&self) -> Option<[usize; 4]> {
        let seen = (0..self.width * self.height).filter(|i| self.rgba[4 * i + 3] > 0);
        let boxed = seen.fold(None, |found: Option<[usize; 4]>, i| {
            let (x, y) = (i % self.width, i / self.width);
            let [left, top, right, bottom] = found.unwrap_or([x, y, x, y]);
            Some([left.min(x), top.min(y), right.max(x), bottom.max(y)])
        });
        boxed.filter(|[left, top, right, bottom]| left < right && top < bottom)
    }

    fn cut(&self, left: usize, top: usize, width: usize, height: usize) -> Self {
        let row = |y: usize| {
            let start = 4 * ((top + y) * self.width + left);
            &self.rgba[start..start + 4 * width]
        };
        Self { width, height, rgba: (0..height).flat_map(row).copied().collect() }
    }

    /// The picture centred in a transparent square; what exceeds the square is cropped.
    fn centred(&self, side: usize) -> Self {
        let mut rgba = vec![0; 4 * side * side];
        let [left, top] = [self.width, self.height].map(|own| (side as i64 - own as i64).div_euclid(2));
        for y in 0..self.height {
            for x in 0..self.width {
                let (to_x, to_y) = (x as i64 + left, y as i64 + top);
                let inside = |v: i64| (0..side as i64).contains(&v);
                if inside(to_x) && inside(to_y) {
                    let (from, to) = (4 * (y * self.width + x), 4 * (to_y as usize * side + to_x as usize));
                    rgba[to..to + 4].copy_from_slice(&self.rgba[from..from + 4]);
                }
            }
        }
        Self { width: side, height: side, rgba }
    }

    /// Resizes with colours weighted by alpha, so that masked pixels do not bleed in.
    fn resize(&self, width: usize, height: usize) -> Result<Self> {
        let area = self.width * self.height;
        let mut planes = vec![0.0; 4 * area];
        for (i, pixel) in self.rgba.chunks_exact(4).enumerate() {
            let alpha = f64::from(pixel[3]);
            for channel in 0..3 {
                planes[channel * area + i] = f64::from(pixel[channel]) * alpha / 255.0;
            }
            planes[3 * area + i] = alpha;
        }
        // rounded to whole grey levels between the two passes, as image programs do
        let tape = Tape::new();
        let level = |x: &Var| (x + 0.5).floor().clamp(0.0, 255.0);
        let planes = level(&tape.constant(Tensor::from_vec(planes, [1, 4, self.height, self.width])));
        let wide = level(&Bicubic::Area.resize(&planes, self.height, width)?);
        let resized = level(&Bicubic::Area.resize(&wide, height, width)?);
        let values = resized.value()?.slice::<f64>();
        let area = width * height;
        let byte = |v: f64| v.round().clamp(0.0, 255.0) as u8;
        let pixel = |i: usize| {
            let alpha = values[3 * area + i];
            let colour = |channel: usize| {
                let weighted = values[channel * area + i];
                if alpha == 0.0 { 0 } else { byte(weighted * 255.0 / alpha) }
            };
            [colour(0), colour(1), colour(2), alpha as u8]
        };
        Ok(Self { width, height, rgba: (0..area).flat_map(pixel).collect() })
    }
}
