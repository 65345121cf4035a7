//! Line plots as SVG. Text is left to the viewer's own sans-serif font, so that no
//! font library is needed.

mod png;

use std::fmt::Display;
use std::io;
use std::ops::Range;

use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

pub use png::png;

/// Colours told apart by the colour-blind too (Okabe & Ito).
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 0, 0),
];
const PANEL: (u32, u32) = (420, 300);
const LEGEND_LINE: u32 = 22;
const FONT: &str = "sans-serif";

/// How a series is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    /// A full line.
    Line,
    /// A dashed line.
    Dashed,
    /// Open circles: published or exact values.
    Points,
    /// Small dots: values of which there are many.
    Dots,
}

/// One curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Name in the legend; curves of one name have one colour in all panels.
    pub label: String,
    /// Abscissa and ordinate.
    pub points: Vec<(f64, f64)>,
    /// How it is drawn.
    pub mark: Mark,
}

impl Series {
    /// A curve.
    pub fn new(label: impl Into<String>, mark: Mark, points: impl IntoIterator<Item = (f64, f64)>) -> Self {
        Self { label: label.into(), points: points.into_iter().collect(), mark }
    }
}

/// One pair of axes.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Panel {
    /// Name of the abscissa with its unit.
    pub x: String,
    /// Name of the ordinate with its unit.
    pub y: String,
    /// The curves.
    pub series: Vec<Series>,
}

/// Panels with one legend below.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Figure {
    /// The panels, row by row.
    pub panels: Vec<Panel>,
    /// Panels in a row, at least one.
    pub columns: usize,
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

impl Figure {
    /// The figure as the text of an SVG file.
    ///
    /// # Errors
    /// When it cannot be drawn, as without any finite point.
    pub fn svg(&self) -> io::Result<String> {
        let columns = self.columns.clamp(1, self.panels.len().max(1));
        let rows = self.panels.len().div_ceil(columns);
        let legend = self.legend();
        let width = PANEL.0 * columns as u32;
        let places = places(&legend, width);
        let lines = places.last().map_or(0, |place| place.1 + 1);
        let height = PANEL.1 * rows as u32;
        let mut text = String::new();
        {
            let root =
                SVGBackend::with_string(&mut text, (width, height + LEGEND_LINE * lines + 6)).into_drawing_area();
            root.fill(&WHITE).map_err(failed)?;
            let (above, below) = root.split_vertically(height);
            for (panel, area) in self.panels.iter().zip(above.split_evenly((rows, columns))) {
                panel.draw(&area, &legend)?;
            }
            for (i, ((label, mark), (x, line))) in legend.iter().zip(&places).enumerate() {
                draw_key(&below, (*x, (line * LEGEND_LINE + LEGEND_LINE / 2) as i32), label, *mark, COLOURS[i % 7])?;
            }
            root.present().map_err(failed)?;
        }
        Ok(text)
    }

    /// Names and marks of all series in order of appearance; the place of a name is its colour.
    fn legend(&self) -> Vec<(&str, Mark)> {
        let mut legend: Vec<(&str, Mark)> = Vec::new();
        for series in self.panels.iter().flat_map(|p| &p.series) {
            if legend.iter().all(|(label, _)| *label != series.label) {
                legend.push((&series.label, series.mark));
            }
        }
        legend
    }
}

/// Where the keys of a legend go: pixels from the left, and line.
fn places(legend: &[(&str, Mark)], width: u32) -> Vec<(i32, u32)> {
    let (mut x, mut line) = (0, 0);
    let mut places = Vec::new();
    for (label, _) in legend {
        // Some seven pixels to a letter at this size, with the sample and a gap.
        let wide = 7 * label.chars().count() as u32 + 60;
        if x > 0 && x + wide > width {
            (x, line) = (0, line + 1);
        }
        places.push((x as i32 + 20, line));
        x += wide;
    }
    places
}

fn failed(error: impl Display) -> io::Error {
    io::Error::other(format!("drawing: {error}"))
}

fn draw_key(area: &Area<'_>, (x, y): (i32, i32), label: &str, mark: Mark, colour: RGBColor) -> io::Result<()> {
    let sample = match mark {
        Mark::Points | Mark::Dots => vec![],
        Mark::Line => vec![(x, x + 26)],
        Mark::Dashed => vec![(x, x + 7), (x + 10, x + 17), (x + 20, x + 26)],
    };
    for (from, to) in sample {
        area.draw(&PathElement::new([(from, y), (to, y)], colour.stroke_width(2))).map_err(failed)?;
    }
    if mark == Mark::Points {
        area.draw(&Circle::new((x + 13, y), 4, colour.stroke_width(2))).map_err(failed)?;
    }
    if mark == Mark::Dots {
        area.draw(&Circle::new((x + 13, y), 3, colour.filled())).map_err(failed)?;
    }
    let style = (FONT, 13).into_font().color(&BLACK).pos(Pos::new(HPos::Left, VPos::Center));
    area.draw(&Text::new(label.to_owned(), (x + 32, y), style)).map_err(failed)
}

impl Panel {
    fn draw(&self, area: &Area<'_>, legend: &[(&str, Mark)]) -> io::Result<()> {
        let finite = || self.series.iter().flat_map(|s| &s.points).filter(|p| p.0.is_finite() && p.1.is_finite());
        let x = span(finite().map(|p| p.0), 0.0).ok_or_else(|| failed("no points"))?;
        let y = span(finite().map(|p| p.1), 0.06).ok_or_else(|| failed("no points"))?;
        let mut chart = ChartBuilder::on(area)
            .margin(12)
            .margin_right(18)
            .x_label_area_size(40)
            .y_label_area_size(56)
            .build_cartesian_2d(x, y)
            .map_err(failed)?;
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(BLACK.mix(0.12))
            .axis_style(BLACK)
            .label_style((FONT, 12))
            .axis_desc_style((FONT, 13))
            .x_labels(6)
            .y_labels(6)
            .x_label_formatter(&|v| tick(*v))
            .y_label_formatter(&|v| tick(*v))
            .x_desc(&self.x)
            .y_desc(&self.y)
            .draw()
            .map_err(failed)?;
        for series in &self.series {
            let colour = legend.iter().position(|(label, _)| *label == series.label).unwrap_or(0);
            series.draw(&mut chart, COLOURS[colour % COLOURS.len()])?;
        }
        Ok(())
    }
}

type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

impl Series {
    fn draw(&self, chart: &mut Chart<'_, '_>, colour: RGBColor) -> io::Result<()> {
        let points = self.points.iter().copied();
        match self.mark {
            Mark::Line => chart.draw_series(LineSeries::new(points, colour.stroke_width(2))).map(|_| ()),
            Mark::Dashed => chart.draw_series(DashedLineSeries::new(points, 7, 4, colour.stroke_width(2))).map(|_| ()),
            Mark::Dots => chart.draw_series(points.map(|p| Circle::new(p, 2, colour.mix(0.4).filled()))).map(|_| ()),
            Mark::Points => chart.draw_series(points.map(|p| Circle::new(p, 4, colour.stroke_width(2)))).map(|_| ()),
        }
        .map_err(failed)
    }
}

/// From least to greatest with a margin, a share of the difference; none without values.
fn span(values: impl Iterator<Item = f64>, margin: f64) -> Option<Range<f64>> {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    if low > high {
        return None;
    }
    let wide = if high > low { high - low } else { low.abs().max(1.0) };
    Some(low - margin * wide..high + margin.max(if high > low { 0.0 } else { 1.0 }) * wide)
}

/// A mark's number, without the digits of rounding.
fn tick(value: f64) -> String {
    let text = format!("{value:.4}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure() -> Figure {
        let line = |label: &str, mark| Series::new(label, mark, (0..20).map(|i| (f64::from(i), f64::from(i * i))));
        let panel = |y: &str| Panel {
            x: "time t, s".into(),
            y: y.into(),
            series: vec![line("exact", Mark::Points), line("here", Mark::Line), line("there", Mark::Dashed)],
        };
        Figure { panels: vec![panel("lift L/W"), panel("drag D/W")], columns: 2 }
    }

    #[test]
    fn a_figure_has_its_labels_and_curves() {
        let svg = figure().svg().unwrap();
        for text in ["time t, s", "lift L/W", "drag D/W", "exact", "here", "there", "<circle", "<polyline"] {
            assert!(svg.contains(text), "{text} in {svg}");
        }
        assert!(svg.trim_end().ends_with("</svg>"));
        // One key and one curve per panel, all of one colour.
        assert_eq!(svg.matches(r##"stroke="#D55E00""##).count(), 3, "{svg}");
    }

    #[test]
    fn the_same_figure_is_the_same_text() {
        assert_eq!(figure().svg().unwrap(), figure().svg().unwrap());
    }

    #[test]
    fn a_figure_without_points_is_an_error() {
        let empty = Figure { panels: vec![Panel::default()], columns: 1 };
        assert!(empty.svg().unwrap_err().to_string().contains("no points"));
    }

    #[test]
    fn marks_have_no_digits_of_rounding() {
        assert_eq!([0.1 + 0.2, -0.0, 12.0, -0.25].map(tick), ["0.3", "0", "12", "-0.25"]);
    }

    #[test]
    fn keys_which_do_not_fit_begin_a_new_line() {
        let legend = [("a long name of a curve", Mark::Line), ("another", Mark::Line)];
        assert_eq!(places(&legend, 220).iter().map(|p| p.1).collect::<Vec<_>>(), [0, 1]);
        assert_eq!(places(&legend, 600).iter().map(|p| p.1).collect::<Vec<_>>(), [0, 0]);
    }
}
