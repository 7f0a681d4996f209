// LAS and LAZ files as a whole, for models that fit into memory; point_stream.h has them in pieces.
#pragma once

#include <string>

#include <palpate/progress.h>
#include <palpate/read_model.h>
#include <palpate/result.h>
#include "toolkit/io/byte_source.h"
#include "toolkit/io/decoding.h"

namespace palpate::io {

/// Versions 1.0 to 1.4 and point formats 0 to 10, plain, as LAZ and as COPC. Properties are intensity, and
/// red, green and blue where the format has them, as the file has them (0 to 65535). Errors name `name` and
/// the byte.
[[nodiscard]] Result<DecodedFile> read_las(const RandomAccess& file, const std::string& name,
                                           const ReadOptions& options, Progress& progress);

/// The same as a Reader (read_model.h), from bytes that come one after the other: they are held as a whole.
[[nodiscard]] Result<DecodedFile> read_las_bytes(const ReaderInput& input);

}  // namespace palpate::io
