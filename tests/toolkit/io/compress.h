// What the reader tests share: compression, and reading from memory.
#pragma once

#include <lzma.h>
#include <zlib.h>

#include <algorithm>
#include <cstdlib>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>

#include <palpate/read_model.h>
#include "toolkit/io/byte_source.h"

namespace palpate::io {

inline std::string gzipped(const std::string& text) {
  z_stream stream{};
  constexpr int kGzip = 16;
  constexpr int kMemory = 8;
  if (deflateInit2(&stream, Z_BEST_COMPRESSION, Z_DEFLATED, MAX_WBITS + kGzip, kMemory, Z_DEFAULT_STRATEGY) !=
      Z_OK)
    std::abort();
  std::string out(deflateBound(&stream, text.size()), '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(text.data()));
  stream.avail_in = static_cast<uInt>(text.size());
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  if (deflate(&stream, Z_FINISH) != Z_STREAM_END) std::abort();
  out.resize(stream.total_out);
  deflateEnd(&stream);
  return out;
}

inline std::string xz_packed(const std::string& text) {
  std::string out(lzma_stream_buffer_bound(text.size()), '\0');
  std::size_t size = 0;
  if (lzma_easy_buffer_encode(1, LZMA_CHECK_CRC32, nullptr,
                              reinterpret_cast<const std::uint8_t*>(text.data()), text.size(),
                              reinterpret_cast<std::uint8_t*>(out.data()), &size, out.size()) != LZMA_OK)
    std::abort();
  out.resize(size);
  return out;
}

/// Reads `content` as a file of this name through the standard readers.
inline Result<ReadModel> read_text(const std::string& content, const std::string& name,
                                   const ReadOptions& options = {}) {
  Readers readers;
  add_standard_readers(readers);
  return readers.read(std::make_unique<MemorySource>(std::as_bytes(std::span(content))), name, options);
}

/// The same of a file that can be read.
inline ReadModel model_of(const std::string& content, const std::string& name,
                          const ReadOptions& options = {}) {
  Result<ReadModel> model = read_text(content, name, options);
  if (!model) throw std::runtime_error(model.error().message());
  return std::move(*model);
}

inline bool warns(const ReadModel& model, const std::string& part) {
  return std::any_of(model.warnings.begin(), model.warnings.end(),
                     [&](const std::string& warning) { return warning.find(part) != std::string::npos; });
}

}  // namespace palpate::io
