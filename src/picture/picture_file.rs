//! Files of pictures that shaders look up, as values of parameters.

use crate::scene::load::{LoadError, LoadOptions, texture};
use crate::scene::{BoundTexture, ColourSpace, Wrap};
use std::fmt;
use std::path::{Path, PathBuf};

/// Extensions of files that are pictures. No other value of a shader's parameter ends so.
const EXTENSIONS: [&str; 11] =
    ["png", "jpg", "jpeg", "webp", "ktx2", "tga", "bmp", "tif", "tiff", "hdr", "exr"];

/// A word behind a file: the encoding of its colours, or how it continues beyond its edges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Word {
    Space(ColourSpace),
    Wrap(Wrap),
}

const WORDS: [(&str, Word); 5] = [
    ("srgb", Word::Space(ColourSpace::Srgb)),
    ("linear", Word::Space(ColourSpace::Linear)),
    ("repeat", Word::Wrap(Wrap::Repeat)),
    ("mirror", Word::Wrap(Wrap::Mirror)),
    ("clamp", Word::Wrap(Wrap::Clamp)),
];

/// A picture's file: `FILE[,linear][,mirror|clamp]`. Without words colours are sRGB, and the picture repeats.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PictureFile {
    /// The file.
    pub path: PathBuf,
    words: Vec<Word>,
}

impl PictureFile {
    /// The file that a value of a shader's parameter names; `None` if it names none.
    pub fn of(value: &str) -> Option<Self> {
        let (mut path, mut words) = (value, Vec::new());
        while let Some((before, last)) = path.rsplit_once(',')
            && let Some((_, word)) = WORDS.iter().find(|(name, _)| *name == last.trim())
        {
            words.insert(0, *word);
            path = before;
        }
        let path = Path::new(path.trim());
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        EXTENSIONS.contains(&&*extension).then(|| Self { path: path.to_owned(), words })
    }

    /// Reads the file.
    ///
    /// # Errors
    /// When it cannot be read or decoded, or is too large.
    pub fn load(&self, options: &LoadOptions) -> Result<BoundTexture, LoadError> {
        let (mut space, mut wrap) = (ColourSpace::Srgb, Wrap::Repeat);
        for word in &self.words {
            match *word {
                Word::Space(one) => space = one,
                Word::Wrap(one) => wrap = one,
            }
        }
        texture(&self.path, space, [wrap; 2], options).map(BoundTexture::new)
    }
}

impl fmt::Display for PictureFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.path.display())?;
        let mut names = self.words.iter().filter_map(|word| WORDS.iter().find(|(_, other)| other == word));
        names.try_for_each(|(name, _)| write!(f, ",{name}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_that_end_like_pictures_are_files() {
        for text in ["dirt.png", "a/b,c.JPG,linear", "mask.exr,linear,clamp", "x.webp,mirror"] {
            let file = PictureFile::of(text).expect(text);
            assert_eq!(file.to_string(), text);
        }
        let file = PictureFile::of("a/b,c.JPG, linear").expect("a file");
        assert_eq!((file.path, file.words.len()), ("a/b,c.JPG".into(), 1));
        for other in ["base-colour", "1,0.5", "0.25", "dirt", "dirt.gif", "linear", ",linear", ""] {
            assert_eq!(PictureFile::of(other), None, "{other}");
        }
    }
}
