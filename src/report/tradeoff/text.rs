//! Text in bitmaps, without the system's fonts: letters of 8 x 8 dots.

use font8x8::legacy::BASIC_LEGACY;
use plotters::prelude::BitMapBackend;
use plotters::style::text_anchor::{HPos, VPos};
use plotters_backend::{
    BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingBackend, DrawingErrorKind,
};

/// Dots along the side of a letter.
const SIDE: i32 = 8;

/// A bitmap that can write.
pub struct Lettered<'a>(pub BitMapBackend<'a>);

type Drawn<'a> = Result<(), DrawingErrorKind<<BitMapBackend<'a> as DrawingBackend>::ErrorType>>;

/// Pixels along the side of a dot in text of this size.
fn dot(size: f64) -> i32 {
    ((size / 14.0).floor() as i32).max(1)
}

impl<'a> DrawingBackend for Lettered<'a> {
    type ErrorType = <BitMapBackend<'a> as DrawingBackend>::ErrorType;

    fn get_size(&self) -> (u32, u32) {
        self.0.get_size()
    }

    fn ensure_prepared(&mut self) -> Drawn<'a> {
        self.0.ensure_prepared()
    }

    fn present(&mut self) -> Drawn<'a> {
        self.0.present()
    }

    fn draw_pixel(&mut self, point: BackendCoord, color: BackendColor) -> Drawn<'a> {
        self.0.draw_pixel(point, color)
    }

    fn draw_rect<S: BackendStyle>(
        &mut self,
        upper_left: BackendCoord,
        bottom_right: BackendCoord,
        style: &S,
        fill: bool,
    ) -> Drawn<'a> {
        self.0.draw_rect(upper_left, bottom_right, style, fill)
    }

    fn draw_text<S: BackendTextStyle>(&mut self, text: &str, style: &S, at: BackendCoord) -> Drawn<'a> {
        let dot = dot(style.size());
        let (width, height) = (SIDE * dot * text.chars().count() as i32, SIDE * dot);
        let left = match style.anchor().h_pos {
            HPos::Left => 0,
            HPos::Center => -width / 2,
            HPos::Right => -width,
        };
        let top = match style.anchor().v_pos {
            VPos::Top => 0,
            VPos::Center => -height / 2,
            VPos::Bottom => -height,
        };
        for (k, letter) in text.chars().enumerate() {
            let rows = BASIC_LEGACY.get(letter as usize).unwrap_or(&BASIC_LEGACY['?' as usize]);
            for (y, row) in rows.iter().enumerate() {
                for x in (0..SIDE).filter(|x| row >> x & 1 == 1) {
                    for (dx, dy) in (0..dot * dot).map(|d| (d % dot, d / dot)) {
                        let place = (left + (SIDE * k as i32 + x) * dot + dx, top + y as i32 * dot + dy);
                        let (x, y) = style.transform().transform(place.0, place.1);
                        self.draw_pixel((at.0 + x, at.1 + y), style.color())?;
                    }
                }
            }
        }
        Ok(())
    }

    fn estimate_text_size<S: BackendTextStyle>(
        &self,
        text: &str,
        style: &S,
    ) -> Result<(u32, u32), DrawingErrorKind<Self::ErrorType>> {
        let side = (SIDE * dot(style.size())) as u32;
        Ok((side * text.chars().count() as u32, side))
    }
}
