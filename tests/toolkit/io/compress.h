// What the reader tests share: compression, and reading from memory.
#pragma once

#include <string>

#include "toolkit/io/read_model.h"

namespace palpate::io {

std::string gzipped(const std::string& text);
std::string xz_packed(const std::string& text);

/// Reads `content` as a file of this name through the standard readers.
Result<ReadModel> read_text(const std::string& content, const std::string& name,
                            const ReadOptions& options = {});

}  // namespace palpate::io
