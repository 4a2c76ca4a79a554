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

/// Every colour of a page as it is in the dark: light, dark. Hues are kept; each has a contrast of at least 3 : 1
/// against the dark ground, as the light ones have against white.
pub(crate) const DARK: [(&str, &str); 12] = [
    ("#0072b2", "#4a9fe0"),
    ("#d55e00", "#ff8a3d"),
    ("#008a64", "#2fc795"),
    ("#b3589a", "#e089c6"),
    ("#b07700", "#dda52c"),
    ("#2e8fc7", "#8fd3f7"),
    ("#1f2328", "#e6edf3"),
    ("#6e7781", "#9198a1"),
    ("#c0232c", "#ff6b6b"),
    ("#57606a", "#9da7b1"),
    ("#d8dee4", "#2d333b"),
    ("#ffffff", "#0d1117"),
];

/// The rules that give pictures their dark colours, for the elements that a selector picks.
pub(crate) fn dark_rules(root: &str) -> String {
    let rule = |(light, dark): &(&str, &str)| {
        format!(
            "{root} svg [fill=\"{light}\"],{root} svg[fill=\"{light}\"]{{fill:{dark}}}{root} svg [stroke=\"{light}\"]{{stroke:{dark}}}"
        )
    };
    DARK.iter().map(rule).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative luminance after WCAG 2.1.
    fn luminance(hex: &str) -> f64 {
        let channel = |at: usize| {
            let value = f64::from(u8::from_str_radix(&hex[at..at + 2], 16).unwrap()) / 255.0;
            if value <= 0.03928 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
        };
        0.2126 * channel(1) + 0.7152 * channel(3) + 0.0722 * channel(5)
    }

    #[test]
    fn every_colour_stands_out_against_white() {
        let others = [Color::Black, Color::Grey, Color::Red];
        for color in Color::CYCLE.into_iter().chain(others) {
            let contrast = 1.05 / (luminance(color.hex()) + 0.05);
            assert!(contrast >= 3.0, "{color:?}: {contrast:.2}");
        }
    }

    #[test]
    fn every_colour_has_a_dark_one_that_stands_out_too() {
        let others = [Color::Black, Color::Grey, Color::Red];
        let ground = luminance("#0d1117") + 0.05;
        for color in Color::CYCLE.into_iter().chain(others) {
            let dark = DARK.iter().find(|(light, _)| *light == color.hex()).unwrap().1;
            let contrast = (luminance(dark) + 0.05) / ground;
            assert!(contrast >= 3.0, "{color:?}: {contrast:.2}");
        }
    }
}
