//! Colours that people with any colour vision can tell apart, on white and in print.
//!
//! After Okabe and Ito, "Color Universal Design" (2008), with yellow left out and the light ones
//! darkened until each has a contrast of at least 3 : 1 against white (WCAG 2.1, 1.4.11, graphics).

/// A colour by its role in a plot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Color {
    /// `#0072b2`
    Blue,
    /// `#d55e00`
    Vermilion,
    /// `#008a64`
    Green,
    /// `#b3589a`
    Purple,
    /// `#b07700`
    Ochre,
    /// `#2e8fc7`
    Sky,
    /// `#1f2328`: for references, so that data stands out in colour.
    Black,
    /// `#6e7781`: for what matters less.
    Grey,
    /// `#c0232c`: for limits and faults; always with a label, never by colour alone.
    Red,
}

impl Color {
    /// Colours for series that name none, in order.
    pub(crate) const CYCLE: [Self; 6] =
        [Self::Blue, Self::Vermilion, Self::Green, Self::Purple, Self::Ochre, Self::Sky];

    /// The colour as HTML writes it.
    pub const fn hex(self) -> &'static str {
        match self {
            Self::Blue => "#0072b2",
            Self::Vermilion => "#d55e00",
            Self::Green => "#008a64",
            Self::Purple => "#b3589a",
            Self::Ochre => "#b07700",
            Self::Sky => "#2e8fc7",
            Self::Black => "#1f2328",
            Self::Grey => "#6e7781",
            Self::Red => "#c0232c",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative luminance after WCAG 2.1.
    fn luminance(color: Color) -> f64 {
        let channel = |at: usize| {
            let value = f64::from(u8::from_str_radix(&color.hex()[at..at + 2], 16).unwrap()) / 255.0;
            if value <= 0.03928 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
        };
        0.2126 * channel(1) + 0.7152 * channel(3) + 0.0722 * channel(5)
    }

    #[test]
    fn every_colour_stands_out_against_white() {
        let others = [Color::Black, Color::Grey, Color::Red];
        for color in Color::CYCLE.into_iter().chain(others) {
            let contrast = 1.05 / (luminance(color) + 0.05);
            assert!(contrast >= 3.0, "{color:?}: {contrast:.2}");
        }
    }
}
