//! Figures as pixels: the same SVG, drawn with a font of our own.

use std::io;

use resvg::tiny_skia::{Color, Pixmap, Transform};
use resvg::usvg::{Options, Tree, fontdb};

/// DejaVu Sans without the letters no figure has.
const LETTERS: &[u8] = include_bytes!("../../assets/DejaVuSans.ttf");

/// An SVG of ours as a PNG file, `scale` pixels to each of its units.
///
/// # Errors
/// When it is no SVG, or has no size.
pub fn png(svg: &str, scale: f32) -> io::Result<Vec<u8>> {
    let mut fonts = fontdb::Database::new();
    fonts.load_font_data(LETTERS.to_vec());
    fonts.set_sans_serif_family("DejaVu Sans");
    let options = Options { fontdb: fonts.into(), font_family: "DejaVu Sans".into(), ..Options::default() };
    let tree = Tree::from_str(svg, &options).map_err(io::Error::other)?;
    let (width, height) = (tree.size().width() * scale, tree.size().height() * scale);
    let none = || io::Error::other("a figure without size");
    let mut pixels = Pixmap::new(width.ceil() as u32, height.ceil() as u32).ok_or_else(none)?;
    pixels.fill(Color::WHITE);
    resvg::render(&tree, Transform::from_scale(scale, scale), &mut pixels.as_mut());
    pixels.encode_png().map_err(io::Error::other)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dark(svg: &str) -> usize {
        let file = png(svg, 2.0).unwrap();
        let pixels = Pixmap::decode_png(&file).unwrap();
        assert_eq!((pixels.width(), pixels.height()), (200, 80));
        pixels.pixels().iter().filter(|p| p.red() < 128).count()
    }

    #[test]
    fn letters_are_drawn() {
        let text = |letters: &str| {
            format!(
                r#"<svg width="100" height="40" xmlns="http://www.w3.org/2000/svg"><text x="5" y="25" font-family="sans-serif" font-size="20">{letters}</text></svg>"#
            )
        };
        assert_eq!(dark(&text("")), 0);
        // Each of these is in the font: none is left out or drawn as the same box.
        let ink: Vec<usize> = ["L", "φ", "²", "±", "−"].map(|l| dark(&text(l))).to_vec();
        assert!(ink.iter().all(|n| *n > 20), "{ink:?}");
        assert!(ink[0] != ink[1] && ink[1] != ink[2], "{ink:?}");
    }
}
