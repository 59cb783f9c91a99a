//! A pixel canvas with its own bitmap font.

use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};
use plotters_backend::text_anchor::{HPos, VPos};
use plotters_backend::{BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingBackend, DrawingErrorKind};
use std::convert::Infallible;

/// An RGB pixel buffer that plotters can draw on.
pub struct Canvas {
    width: usize,
    height: usize,
    rgb: Vec<u8>,
    /// Coverage of each pixel by the current path, 0 to 1; zero between paths.
    cover: Vec<f32>,
}

impl Canvas {
    /// Creates a white canvas.
    pub fn new((width, height): (u32, u32)) -> Self {
        let (width, height) = (width as usize, height as usize);
        Self { width, height, rgb: vec![255; 3 * width * height], cover: vec![0.0; width * height] }
    }

    /// Encodes the pixels as PNG.
    ///
    /// # Errors
    /// The width or height is zero.
    pub fn png(&self) -> Result<Vec<u8>, png::EncodingError> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::High);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&self.rgb)?;
        writer.finish()?;
        Ok(bytes)
    }

    fn blend(&mut self, x: i32, y: i32, (r, g, b): (u8, u8, u8), alpha: f64) {
        let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) else { return };
        if x >= self.width || y >= self.height {
            return;
        }
        let at = 3 * (y * self.width + x);
        for (old, new) in self.rgb[at..at + 3].iter_mut().zip([r, g, b]) {
            *old = (f64::from(*old) * (1.0 - alpha) + f64::from(new) * alpha).round() as u8;
        }
    }

    /// Draws a polyline with round joints; blends each pixel once.
    fn stroke(&mut self, path: &[BackendCoord], width: u32, colour: BackendColor) {
        let half = 0.5 * f64::from(width.max(1));
        let reach = half.ceil() as i32 + 1;
        let mut box_ = [i32::MAX, i32::MAX, i32::MIN, i32::MIN];
        let limit = |value: i32, size: usize| value.clamp(0, size as i32);
        for pair in path.windows(2) {
            let ((x0, y0), (x1, y1)) = (pair[0], pair[1]);
            let (left, right) = (limit(x0.min(x1) - reach, self.width), limit(x0.max(x1) + reach + 1, self.width));
            let (top, bottom) = (limit(y0.min(y1) - reach, self.height), limit(y0.max(y1) + reach + 1, self.height));
            let (dx, dy) = (f64::from(x1 - x0), f64::from(y1 - y0));
            let length_squared = dx * dx + dy * dy;
            for y in top..bottom {
                for x in left..right {
                    let (px, py) = (f64::from(x - x0), f64::from(y - y0));
                    let along =
                        if length_squared > 0.0 { ((px * dx + py * dy) / length_squared).clamp(0.0, 1.0) } else { 0.0 };
                    let (ex, ey) = (px - along * dx, py - along * dy);
                    let cover = (half + 0.5 - (ex * ex + ey * ey).sqrt()).clamp(0.0, 1.0) as f32;
                    let old = &mut self.cover[y as usize * self.width + x as usize];
                    *old = old.max(cover);
                }
            }
            box_ = [box_[0].min(left), box_[1].min(top), box_[2].max(right), box_[3].max(bottom)];
        }
        for y in box_[1]..box_[3] {
            for x in box_[0]..box_[2] {
                let cover = std::mem::take(&mut self.cover[y as usize * self.width + x as usize]);
                if cover > 0.0 {
                    self.blend(x, y, colour.rgb, f64::from(cover) * colour.alpha);
                }
            }
        }
    }
}

/// Returns the font size for a text height in pixels.
fn raster_height(size: f64) -> RasterHeight {
    if size < 18.0 { RasterHeight::Size16 } else { RasterHeight::Size20 }
}

/// Replaces letters that the font lacks.
fn plain(text: &str) -> String {
    let mut plain = String::with_capacity(text.len());
    for letter in text.chars() {
        if get_raster(letter, FontWeight::Regular, RasterHeight::Size16).is_some() {
            plain.push(letter);
            continue;
        }
        plain.push_str(match letter {
            'Δ' => "Delta",
            'σ' => "sigma",
            'ρ' => "rho",
            'η' => "eta",
            'µ' | 'μ' => "mu",
            'φ' => "phi",
            '−' => "-",
            '≥' => ">=",
            '≤' => "<=",
            '²' => "^2",
            _ => "?",
        });
    }
    plain
}

impl DrawingBackend for &mut Canvas {
    type ErrorType = Infallible;

    fn get_size(&self) -> (u32, u32) {
        (self.width as u32, self.height as u32)
    }

    fn ensure_prepared(&mut self) -> Result<(), DrawingErrorKind<Infallible>> {
        Ok(())
    }

    fn present(&mut self) -> Result<(), DrawingErrorKind<Infallible>> {
        Ok(())
    }

    fn draw_pixel(&mut self, (x, y): BackendCoord, colour: BackendColor) -> Result<(), DrawingErrorKind<Infallible>> {
        self.blend(x, y, colour.rgb, colour.alpha);
        Ok(())
    }

    fn draw_line<S: BackendStyle>(
        &mut self,
        from: BackendCoord,
        to: BackendCoord,
        style: &S,
    ) -> Result<(), DrawingErrorKind<Infallible>> {
        self.stroke(&[from, to], style.stroke_width(), style.color());
        Ok(())
    }

    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        path: I,
        style: &S,
    ) -> Result<(), DrawingErrorKind<Infallible>> {
        let path: Vec<BackendCoord> = path.into_iter().collect();
        self.stroke(&path, style.stroke_width(), style.color());
        Ok(())
    }

    fn draw_text<S: BackendTextStyle>(
        &mut self,
        text: &str,
        style: &S,
        (x, y): BackendCoord,
    ) -> Result<(), DrawingErrorKind<Infallible>> {
        let text = plain(text);
        let height = raster_height(style.size());
        let step = get_raster_width(FontWeight::Regular, height) as i32;
        let (width, tall) = (step * text.chars().count() as i32, height.val() as i32);
        let left = match style.anchor().h_pos {
            HPos::Left => 0,
            HPos::Center => -width / 2,
            HPos::Right => -width,
        };
        let top = match style.anchor().v_pos {
            VPos::Top => 0,
            VPos::Center => -tall / 2,
            VPos::Bottom => -tall,
        };
        let colour = style.color();
        for (i, letter) in text.chars().enumerate() {
            let Some(raster) = get_raster(letter, FontWeight::Regular, height) else { continue };
            for (row, pixels) in raster.rows().enumerate() {
                for (column, cover) in pixels.iter().enumerate().filter(|(_, cover)| **cover > 0) {
                    let at = style.transform().transform(left + step * i as i32 + column as i32, top + row as i32);
                    self.blend(x + at.0, y + at.1, colour.rgb, f64::from(*cover) / 255.0 * colour.alpha);
                }
            }
        }
        Ok(())
    }

    fn estimate_text_size<S: BackendTextStyle>(
        &self,
        text: &str,
        style: &S,
    ) -> Result<(u32, u32), DrawingErrorKind<Infallible>> {
        let height = raster_height(style.size());
        let step = get_raster_width(FontWeight::Regular, height);
        Ok(((step * plain(text).chars().count()) as u32, height.val() as u32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_without_a_raster_are_spelt_out() {
        assert_eq!(plain("Δ ≥ 2 m"), "Delta >= 2 m");
    }
}
