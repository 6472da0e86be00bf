//! What several share equally, and what they have one after another.

use super::clock::{Time, seconds, time};
use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};

/// A link or a processor that those who use it share equally.
///
/// Each user gets the same, so the one that needs least is the first to end. `each` counts what each user has got so
/// far; a user ends when it reaches the value at which it began plus what it needs.
#[derive(Debug)]
pub struct Shared<T> {
    /// What it does in a second.
    capacity: f64,
    /// The most that one user gets in a second.
    most_each: f64,
    each: f64,
    at: Time,
    entered: u64,
    users: BinaryHeap<Reverse<User<T>>>,
    /// What it has done in all.
    done: f64,
}

#[derive(Debug)]
struct User<T> {
    end: f64,
    seq: u64,
    token: T,
}

impl<T> PartialEq for User<T> {
    #[inline]
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl<T> Eq for User<T> {}

impl<T> PartialOrd for User<T> {
    #[inline]
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl<T> Ord for User<T> {
    #[inline]
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.end.total_cmp(&other.end).then(self.seq.cmp(&other.seq))
    }
}

impl<T> Shared<T> {
    /// A capacity a second. One user gets at most `most_each` of it.
    pub fn new(capacity: f64, most_each: f64) -> Self {
        let (each, at, entered, users, done) = (0.0, 0, 0, BinaryHeap::new(), 0.0);
        Self { capacity, most_each, each, at, entered, users, done }
    }

    /// Changes what it does in a second, and the most that one user gets.
    pub fn set_capacity(&mut self, now: Time, capacity: f64, most_each: f64) {
        self.advance(now);
        (self.capacity, self.most_each) = (capacity, most_each);
    }

    /// What each user gets in a second now.
    #[inline]
    fn rate(&self) -> f64 {
        self.most_each.min(self.capacity / self.users.len().max(1) as f64)
    }

    #[inline]
    fn advance(&mut self, now: Time) {
        if !self.users.is_empty() {
            let got = seconds(now - self.at) * self.rate();
            self.each += got;
            self.done += got * self.users.len() as f64;
        }
        self.at = now;
    }

    /// Lets a user in that needs so much.
    #[inline]
    pub fn add(&mut self, now: Time, needed: f64, token: T) {
        self.advance(now);
        if self.users.is_empty() {
            // Small numbers are more exact.
            self.each = 0.0;
        }
        self.entered += 1;
        self.users.push(Reverse(User { end: self.each + needed, seq: self.entered, token }));
    }

    /// The time at which the next user ends if nothing changes.
    #[inline]
    pub fn due(&self) -> Option<Time> {
        let Reverse(first) = self.users.peek()?;
        let left = (first.end - self.each).max(0.0);
        Some(self.at + time(left / self.rate()))
    }

    /// Lets the next user go, which ends now.
    #[inline]
    pub fn end(&mut self, now: Time) -> Option<T> {
        self.advance(now);
        self.users.pop().map(|Reverse(user)| user.token)
    }

    /// Lets all users go, and tells how many there were.
    pub fn clear(&mut self, now: Time) -> usize {
        self.advance(now);
        let users = self.users.len();
        self.users.clear();
        users
    }

    /// The sum of what its users have got by now.
    pub fn done(&mut self, now: Time) -> f64 {
        self.advance(now);
        self.done
    }
}

/// A thing that a few have at the same time while the others wait in the order in which they came.
#[derive(Debug)]
pub struct Turns<T> {
    free: usize,
    waiting: VecDeque<T>,
}

impl<T> Turns<T> {
    /// For so many at the same time.
    pub fn new(free: usize) -> Self {
        Self { free, waiting: VecDeque::new() }
    }

    /// Returns who came if it is its turn, else lets it wait.
    #[inline]
    pub fn come(&mut self, who: T) -> Option<T> {
        if self.free == 0 {
            self.waiting.push_back(who);
            return None;
        }
        self.free -= 1;
        Some(who)
    }

    /// Lets one that comes wait before all others, if it is not its turn.
    pub fn come_first(&mut self, who: T) -> Option<T> {
        if self.free == 0 {
            self.waiting.push_front(who);
            return None;
        }
        self.free -= 1;
        Some(who)
    }

    /// Whose turn it is now that one has gone.
    #[inline]
    pub fn go(&mut self) -> Option<T> {
        let next = self.waiting.pop_front();
        if next.is_none() {
            self.free += 1;
        }
        next
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// When users end that come at these times with these needs.
    fn ends(mut shared: Shared<usize>, users: &[(f64, f64)]) -> Vec<f64> {
        let mut ends = vec![0.0; users.len()];
        let mut coming: VecDeque<(usize, (f64, f64))> = users.iter().copied().enumerate().collect();
        loop {
            let next = coming.front().map(|(_, (at, _))| time(*at));
            match (shared.due(), next) {
                (Some(due), next) if next.is_none_or(|next| due <= next) => {
                    if let Some(user) = shared.end(due) {
                        ends[user] = seconds(due);
                    }
                }
                (_, Some(next)) => {
                    let (user, (_, needed)) = coming.pop_front().expect("there is one");
                    shared.add(next, needed, user);
                }
                (_, None) => return ends,
            }
        }
    }

    fn assert_near(found: &[f64], expected: &[f64]) {
        let is_near = found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6);
        assert!(is_near && found.len() == expected.len(), "{found:?}, not {expected:?}");
    }

    #[test]
    fn users_share_equally() {
        assert_near(&ends(Shared::new(10.0, 10.0), &[(0.0, 10.0)]), &[1.0]);
        assert_near(&ends(Shared::new(10.0, 10.0), &[(0.0, 10.0), (0.0, 20.0)]), &[2.0, 3.0]);
        // The second comes when the first has half.
        assert_near(&ends(Shared::new(10.0, 10.0), &[(0.0, 10.0), (0.5, 5.0)]), &[1.5, 1.5]);
        // One alone gets no more than its own link carries.
        assert_near(
            &ends(Shared::new(10.0, 5.0), &[(0.0, 10.0), (0.0, 10.0), (0.0, 20.0)]),
            &[3.0, 3.0, 5.0],
        );
    }

    #[test]
    fn turns_are_taken_in_order() {
        let mut turns = Turns::new(1);
        assert_eq!((turns.come(1), turns.come(2), turns.come(3)), (Some(1), None, None));
        assert_eq!(turns.come_first(4), None);
        assert_eq!([turns.go(), turns.go(), turns.go(), turns.go()], [Some(4), Some(2), Some(3), None]);
        assert_eq!(turns.come(5), Some(5));
    }
}
