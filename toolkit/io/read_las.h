// LAS and LAZ files: as a whole, for models that fit into memory, and in pieces.
#pragma once

#include <memory>
#include <string>

#include <palpate/progress.h>
#include <palpate/read_model.h>
#include <palpate/result.h>
#include "toolkit/io/byte_source.h"
#include "toolkit/io/decoding.h"
#include "toolkit/io/point_stream.h"

namespace palpate::io {

/// Versions 1.0 to 1.4 and point formats 0 to 10, plain, as LAZ and as COPC. Properties are intensity, and
/// red, green and blue where the format has them, as the file has them (0 to 65535). Errors name `name` and
/// the byte.
[[nodiscard]] Result<DecodedFile> read_las(const RandomAccess& file, const std::string& name,
                                           const ReadOptions& options, Progress& progress);

/// The same as a Reader (read_model.h), from bytes that come one after the other: they are held as a whole.
[[nodiscard]] Result<DecodedFile> read_las_bytes(const ReaderInput& input);

/// Points in pieces. `threads` decode chunks of LAZ; 0 is all of the machine's. `name` is for messages.
[[nodiscard]] Result<std::unique_ptr<PointStream>> las_stream(std::unique_ptr<RandomAccess> file,
                                                              const std::string& name, int threads);

}  // namespace palpate::io
