//! Colours of series and of values.

use plotters::style::RGBColor;

/// Colours of series by number. They also differ in lightness, so that they stay distinct in a grey print.
pub const COLOURS: [RGBColor; 8] = [
    RGBColor(31, 119, 180),
    RGBColor(214, 39, 40),
    RGBColor(44, 140, 60),
    RGBColor(255, 127, 14),
    RGBColor(120, 80, 160),
    RGBColor(110, 110, 110),
    RGBColor(23, 170, 190),
    RGBColor(0, 0, 0),
];

/// Index of grey in [`COLOURS`].
pub const GREY: usize = 5;
/// Index of black in [`COLOURS`].
pub const BLACK: usize = 7;

/// Returns a colour of the scale from dark blue through green to yellow; lightness increases with the value.
pub fn scale_colour(value: f64) -> RGBColor {
    const STOPS: [[f64; 3]; 5] =
        [[68.0, 20.0, 95.0], [59.0, 82.0, 139.0], [33.0, 145.0, 140.0], [94.0, 201.0, 98.0], [253.0, 231.0, 37.0]];
    let at = value.clamp(0.0, 1.0) * (STOPS.len() - 1) as f64;
    let below = (at as usize).min(STOPS.len() - 2);
    let share = at - below as f64;
    let channel = |k: usize| (STOPS[below][k] * (1.0 - share) + STOPS[below + 1][k] * share).round() as u8;
    RGBColor(channel(0), channel(1), channel(2))
}

/// Returns the CSS colour of a series. Black becomes `currentColor`, the text colour of the page, which stays visible
/// in dark mode.
pub fn css_colour(number: usize) -> String {
    if number == BLACK {
        return "currentColor".to_owned();
    }
    let RGBColor(r, g, b) = COLOURS[number % COLOURS.len()];
    format!("#{r:02x}{g:02x}{b:02x}")
}
