// SPDX-License-Identifier: GPL-3.0-or-later
//! A medium that absorbs light on its way, everywhere the same.

use crate::error::Error;

/// Absorption of each colour, per scene unit.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Medium {
    sigma: [f64; 3],
}

impl Medium {
    /// An error where an absorption is negative or not finite.
    pub fn new(sigma: [f64; 3]) -> Result<Self, Error> {
        match sigma.iter().find(|sigma| !(sigma.is_finite() && **sigma >= 0.0)) {
            Some(&wrong) => Err(Error::Absorption(wrong)),
            None => Ok(Self { sigma }),
        }
    }

    /// Whether it lets all light through.
    pub fn is_clear(&self) -> bool {
        self.sigma == [0.0; 3]
    }

    /// The share of light of the first C colours that is left after so many scene units (Beer and Lambert).
    pub fn left<const C: usize>(&self, distance: f64) -> [f64; C] {
        std::array::from_fn(|c| (-self.sigma[c] * distance).exp())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_of_light_multiplies_along_its_way() {
        let medium = Medium::new([0.0, 0.5, 2.0]).unwrap();
        let [a, b, both]: [[f64; 3]; 3] = [0.3, 1.1, 1.4].map(|distance| medium.left(distance));
        assert!((0..3).all(|c| (a[c] * b[c] - both[c]).abs() < 1e-15));
        assert_eq!(medium.left::<1>(1.0), [1.0]);
        assert!((both[2] - (-2.8f64).exp()).abs() < 1e-15);
    }

    #[test]
    fn light_does_not_grow() {
        assert!(Medium::new([0.0, -1.0, 0.0]).is_err());
        assert!(Medium::new([0.0, f64::NAN, 0.0]).is_err());
        assert!(Medium::default().is_clear() && !Medium::new([0.0, 0.0, 1e-9]).unwrap().is_clear());
    }
}
