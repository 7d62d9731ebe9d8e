//! High dynamic range: code values of PQ (SMPTE ST 2084) and HLG (ARIB STD-B67) to sRGB.

use crate::video::image::Image;

/// Luminance of white in PQ \[cd/m²\] and the signal of white in HLG, after ITU-R BT.2408.
const WHITE: (f64, f64) = (203.0, 0.75);

/// Linear BT.2020 colours to linear BT.709 colours, after ITU-R BT.2087.
const NARROWED: [[f32; 3]; 3] = [[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]];

/// Number of steps in the table of the sRGB curve.
const STEPS: usize = 4096;

/// The curve by which a film codes light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Transfer {
    Pq,
    Hlg,
}

impl Transfer {
    /// The transfer of this name in ffmpeg's words, if it is one of high dynamic range.
    pub fn of(name: &str) -> Option<Self> {
        match name {
            "smpte2084" => Some(Self::Pq),
            "arib-std-b67" => Some(Self::Hlg),
            _ => None,
        }
    }

    /// What is assumed.
    pub fn said(self) -> String {
        let (name, white) = match self {
            Self::Pq => ("PQ", format!("{} cd/m²", WHITE.0)),
            Self::Hlg => ("HLG", format!("{:.0} % of the signal", 100.0 * WHITE.1)),
        };
        format!("the film is HDR ({name}): it is shown in SDR with white at {white}, and what is brighter as white")
    }

    /// Linear light of a signal from 0 to 1, in units of white.
    fn light(self, signal: f64) -> f64 {
        let pq = |signal: f64| {
            let (m, n) = (2523.0 / 32.0, 1305.0 / 8192.0);
            let (c1, c2, c3) = (107.0 / 128.0, 2413.0 / 128.0, 2392.0 / 128.0);
            let root = signal.powf(1.0 / m);
            10_000.0 * ((root - c1).max(0.0) / (c2 - c3 * root)).powf(1.0 / n)
        };
        let hlg = |signal: f64| {
            let a = 0.178_832_77_f64;
            let (b, c) = (1.0 - 4.0 * a, 0.5 - a * (4.0 * a).ln());
            if signal <= 0.5 { signal * signal / 3.0 } else { (((signal - c) / a).exp() + b) / 12.0 }
        };
        match self {
            Self::Pq => pq(signal) / WHITE.0,
            Self::Hlg => hlg(signal) / hlg(WHITE.1),
        }
    }
}

/// Turns pictures of high dynamic range into sRGB.
#[derive(Debug, Clone)]
pub(super) struct Standard {
    light: [f32; 256],
    codes: Vec<u8>,
    is_wide: bool,
}

impl Standard {
    /// For pictures of this transfer; `is_wide` if their colours are those of BT.2020.
    pub fn of(transfer: Transfer, is_wide: bool) -> Self {
        let light = std::array::from_fn(|code| transfer.light(code as f64 / 255.0) as f32);
        let code =
            |light: f64| if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 };
        let codes = (0..=STEPS).map(|k| (255.0 * code(k as f64 / STEPS as f64)).round() as u8).collect();
        Self { light, codes, is_wide }
    }

    /// Converts a picture.
    pub fn apply(&self, image: &mut Image) {
        for pixel in &mut image.pixels {
            let [r, g, b] = [0, 1, 2].map(|c| self.light[usize::from(pixel[c])]);
            let light = if self.is_wide { NARROWED.map(|row| row[0] * r + row[1] * g + row[2] * b) } else { [r, g, b] };
            for (value, light) in pixel.iter_mut().zip(light) {
                *value = self.codes[(light.clamp(0.0, 1.0) * STEPS as f32).round() as usize];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of ITU-R BT.2100 and BT.2408.
    #[test]
    fn curves_go_through_their_known_points() {
        // 100 cd/m² are 50.8 % of PQ, 203 are 58.1 %, and 10 000 the whole
        for (signal, nits) in [(0.508, 100.0), (0.581, 203.0), (1.0, 10_000.0)] {
            let found = WHITE.0 * Transfer::Pq.light(signal);
            assert!((found / nits - 1.0).abs() < 0.01, "{signal}: {found} cd/m²");
        }
        // a twelfth of the peak is half of the HLG signal
        let peak = Transfer::Hlg.light(1.0);
        assert!((Transfer::Hlg.light(0.5) / peak - 1.0 / 12.0).abs() < 1e-6);
        assert!((Transfer::Hlg.light(0.75) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn grey_stays_grey_and_white_becomes_white() {
        for transfer in [Transfer::Pq, Transfer::Hlg] {
            let white = (0..=255u8).find(|code| transfer.light(f64::from(*code) / 255.0) >= 1.0).unwrap();
            let pixels = vec![[white, white, white, 9], [0, 0, 0, 255], [90, 90, 90, 255]];
            let mut image = Image { width: 3, height: 1, pixels, has_alpha: true };
            Standard::of(transfer, true).apply(&mut image);
            assert_eq!(image.pixels[..2], [[255, 255, 255, 9], [0, 0, 0, 255]]);
            let [r, g, b, _] = image.pixels[2];
            assert!(r.abs_diff(g) <= 1 && g.abs_diff(b) <= 1 && (30..220).contains(&g), "{r} {g} {b}");
        }
    }
}
