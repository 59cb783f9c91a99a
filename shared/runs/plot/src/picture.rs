//! Charts as data.

/// A titled grid of charts.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Picture {
    /// Title above the grid.
    pub title: String,
    /// Width and height, px.
    pub size: (u32, u32),
    /// Number of charts per row.
    pub columns: usize,
    /// The charts, row by row.
    pub charts: Vec<Chart>,
}

/// One chart.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Chart {
    /// Caption above the chart.
    pub caption: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Series, drawn in this order.
    pub series: Vec<Series>,
    /// Whether both axes have the same scale.
    pub equal_scale: bool,
    /// Corner of the legend, which lists the named series.
    pub legend: Legend,
}

/// An axis.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Axis {
    /// Quantity and unit.
    pub label: String,
    /// Limits; `None` derives them from the data.
    pub range: Option<[f64; 2]>,
    /// Labels that replace the numbers 0, 1, 2 ..; only in HTML pages.
    pub names: Vec<String>,
}

impl Axis {
    /// Creates an axis with limits from the data.
    pub fn auto(label: &str) -> Self {
        Self { label: label.to_owned(), ..Self::default() }
    }

    /// Creates an axis with fixed limits.
    pub fn fixed(label: &str, from: f64, to: f64) -> Self {
        Self { label: label.to_owned(), range: Some([from, to]), names: Vec::new() }
    }
}

/// Corner of the legend.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Legend {
    /// Upper right.
    #[default]
    UpperRight,
    /// Upper left.
    UpperLeft,
    /// Lower right.
    LowerRight,
    /// Lower left.
    LowerLeft,
}

/// Points drawn in one style.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Name in the legend; empty for no entry.
    pub name: String,
    /// Index in [`crate::COLOURS`].
    pub colour: usize,
    /// Drawing style.
    pub style: SeriesStyle,
    /// x and y. A value that is not finite interrupts a line.
    pub points: Vec<[f64; 2]>,
}

/// Drawing style of a series.
#[derive(Debug, Clone, PartialEq)]
pub enum SeriesStyle {
    /// A line of this width, px.
    Line(u32),
    /// A dashed line.
    Dashed,
    /// A line with a disc at each point.
    Marked,
    /// Discs of this radius, px.
    Discs(u32),
    /// Bars from y = 0 of this width in units of x.
    Bars(f64),
    /// Rectangles of this size centred at the points, each in the colour of its value from 0 to 1 on the colour scale.
    Cells([f64; 2], Vec<f64>),
    /// Discs of this radius in px, each in the colour of its value from 0 to 1 on the colour scale.
    Scaled(u32, Vec<f64>),
    /// Area between the points and these values of y.
    Band(Vec<f64>),
    /// Filled rectangles; two points each, opposite corners.
    Blocks,
}

impl Series {
    /// Creates a line series of 2 px.
    pub fn line(name: &str, colour: usize, points: Vec<[f64; 2]>) -> Self {
        Self { name: name.to_owned(), colour, style: SeriesStyle::Line(2), points }
    }

    /// Returns the series with another style.
    #[must_use]
    pub fn with_style(self, style: SeriesStyle) -> Self {
        Self { style, ..self }
    }
}
