// STL meshes, binary and as text. Short, because the format is triangles and nothing else.
#pragma once

#include <palpate/result.h>
#include "toolkit/io/decoding.h"

namespace palpate::io {

/// The file's triangles as its own mesh. Each facet lists its own corners, so corners at bit-identical places
/// become one vertex; facets that lose a corner by it, or have one that is not finite, are dropped and
/// counted. A text begins with "solid", which some binary files do too: the size decides first. STL has no
/// unit.
[[nodiscard]] Result<DecodedFile> read_stl(const ReaderInput& input);

}  // namespace palpate::io
