// What the reader tests share: compression, and reading from memory.
#pragma once

#include <lzma.h>
#include <zlib.h>

#include <cstdlib>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <palpate/progress.h>
#include <palpate/read_model.h>
#include "tests/toolkit/messages.h"
#include "toolkit/io/byte_source.h"
#include "toolkit/io/decoding.h"
#include "toolkit/io/point_stream.h"

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
  return test::value_of(read_text(content, name, options));
}

using ReadFile = Result<DecodedFile> (*)(const ReaderInput&);
using StreamFile = Result<std::unique_ptr<PointStream>> (*)(std::unique_ptr<RandomAccess>,
                                                            const std::string&);
inline const std::string kFileName = "a.file";

/// What a format's reader finds in `content`, a file of kFileName.
inline Result<DecodedFile> decode(ReadFile read, const std::string& content,
                                  std::uint64_t max_bytes = kMemoryLimitBytes) {
  MemorySource source(std::as_bytes(std::span(content)));
  ReadOptions options;
  options.max_bytes = max_bytes;
  return read(ReaderInput{source, kFileName, options, no_progress()});
}

/// All points of a stream over `content`, `piece` at a time.
inline Result<std::vector<Vec3>> stream(StreamFile open, const std::string& content, std::size_t piece) {
  PALPATE_ASSIGN(auto points,
                 open(std::make_unique<MemoryAccess>(std::as_bytes(std::span(content))), kFileName));
  std::vector<Vec3> all, some(piece);
  while (true) {
    PALPATE_ASSIGN(const std::size_t n, points->read(some));
    if (n == 0) return all;
    all.insert(all.end(), some.begin(), some.begin() + static_cast<std::ptrdiff_t>(n));
  }
}

/// An error that says each of the parts, its line and a remedy.
template <class R>
void expect_named(const R& result, const std::vector<std::string>& parts, std::int64_t line) {
  ASSERT_FALSE(result) << "accepted, not refused for " << parts.front();
  for (const std::string& part : parts) EXPECT_TRUE(test::contains(result.error().message(), part));
  EXPECT_EQ(result.error().line, line) << result.error().message();
  EXPECT_FALSE(result.error().remedy.empty()) << result.error().message();
}

inline bool warns(const ReadModel& model, const std::string& part) {
  return test::any_says(model.warnings, part);
}

}  // namespace palpate::io
