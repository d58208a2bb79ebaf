//! Memory that tasks hand on to one another.

use std::sync::{Mutex, PoisonError};

/// As many of something as threads needed at once. Unlike what [`rayon::iter::ParallelIterator::fold`] makes, no task
/// makes its own while another's lies idle.
#[derive(Debug)]
pub struct Reused<S>(Mutex<Vec<S>>);

impl<S> Default for Reused<S> {
    fn default() -> Self {
        Self(Mutex::new(Vec::new()))
    }
}

impl<S> Reused<S> {
    /// Runs `task` with one that is idle, or a new one.
    ///
    /// # Errors
    /// When none can be made.
    pub fn lend<R, E>(&self, make: impl FnOnce() -> Result<S, E>, task: impl FnOnce(&mut S) -> R) -> Result<R, E> {
        let idle = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut lent = idle.map_or_else(make, Ok)?;
        let result = task(&mut lent);
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(lent);
        Ok(result)
    }

    /// All that were made.
    #[must_use]
    pub fn into_all(self) -> Vec<S> {
        self.0.into_inner().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use rayon::prelude::*;

    use super::*;

    #[test]
    fn there_are_no_more_than_threads() {
        let sums = Reused::default();
        (0..1000_u32).into_par_iter().with_max_len(1).for_each(|number| {
            let made = sums.lend(|| Ok::<_, Infallible>(0), |sum| *sum += number);
            assert!(made.is_ok());
        });
        let sums = sums.into_all();
        assert!(sums.len() <= rayon::current_num_threads());
        assert_eq!(sums.iter().sum::<u32>(), 499_500);
    }
}
