//! What belongs together.

/// Disjoint sets of numbers.
pub struct Sets(Vec<u32>);

impl Sets {
    /// Every number below `count` by itself.
    pub fn new(count: usize) -> Sets {
        Sets((0..count as u32).collect())
    }

    /// The number that stands for the set of `i`: its least.
    pub fn of(&mut self, mut i: u32) -> u32 {
        while self.0[i as usize] != i {
            let above = self.0[self.0[i as usize] as usize];
            self.0[i as usize] = above;
            i = above;
        }
        i
    }

    /// [`Sets::of`] of every number.
    pub fn all(mut self) -> Vec<u32> {
        (0..self.0.len() as u32).map(|i| self.of(i)).collect()
    }

    /// Makes one set of the sets of `a` and `b`.
    pub fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.of(a), self.of(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}
