// Fuzzes files of prepared cells: an Error that names the file, or finite points, in bounded memory. The
// hashes are made to agree with the bytes, because no input would pass them otherwise.
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "tests/fuzz/must.h"
#include "toolkit/core/bytes.h"
#include "toolkit/core/hash.h"
#include "toolkit/prepared/cell_file.h"

namespace {

using namespace palpate;

std::uint64_t hash_of(std::span<const std::byte> bytes) {
  Hash64 hash;
  hash.bytes(bytes);
  return hash.value();
}

void put(std::span<std::byte> at, std::uint64_t number) {
  ByteWriter(at).u64(number);
}

/// Magic, version and hashes as a reader wants them, and the table at the end.
void sign(std::span<std::byte> file) {
  constexpr std::size_t kVersionAt = 8, kCellsAt = 40, kTableOffsetAt = 48, kTableHashAt = 56;
  if (file.size() < prepared::kCellHeaderBytes) return;
  ByteWriter head(file);
  head.raw(std::as_bytes(std::span("PALCELLS", kVersionAt)));
  head.u32(prepared::kCellFileVersion);
  head.u32(static_cast<std::uint32_t>(prepared::kCellHeaderBytes));
  ByteReader number(file.subspan(kCellsAt));
  const std::uint64_t most = (file.size() - prepared::kCellHeaderBytes) / prepared::kCellEntryBytes;
  const std::uint64_t cells = std::min(number.u64(), most);
  put(file.subspan(kCellsAt), cells);
  const std::span<std::byte> table = file.last(static_cast<std::size_t>(cells) * prepared::kCellEntryBytes);
  const std::size_t offset = file.size() - table.size();
  put(file.subspan(kTableOffsetAt), offset);
  for (std::size_t cell = 0; cell < cells; ++cell) {
    const auto line = table.subspan(cell * prepared::kCellEntryBytes, prepared::kCellEntryBytes);
    ByteReader reader{std::span<const std::byte>(line)};
    const prepared::CellEntry entry = prepared::read_cell_entry(reader);
    if (entry.offset <= offset && entry.bytes() <= offset - entry.offset)
      put(line.last(sizeof(std::uint64_t)), hash_of(file.subspan(static_cast<std::size_t>(entry.offset),
                                                                 static_cast<std::size_t>(entry.bytes()))));
  }
  put(file.subspan(kTableHashAt), hash_of(table));
  const std::size_t end = prepared::kCellHeaderBytes - sizeof(std::uint64_t);
  put(file.subspan(end), hash_of(file.first(end)));
}

void read_all(const prepared::CellFile& file) {
  std::uint64_t own = 0;
  for (std::size_t cell = 0; cell < file.size(); ++cell) {
    const auto points = file.read_cell(cell);
    if (!points) {
      must(!points.error().what.empty() && points.error().file == file.path());
      continue;
    }
    own += points->own;
    for (const Vec3& p : points->points_mm) must(is_finite(p));
  }
  must(own <= file.info().points);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto given = std::as_bytes(std::span(data, size));
  std::vector<std::byte> bytes(given.begin(), given.end());
  sign(bytes);
  static const int memory = ::memfd_create("fuzzed", 0);
  must(memory >= 0 && ::ftruncate(memory, 0) == 0);
  must(::pwrite(memory, bytes.data(), bytes.size(), 0) == static_cast<ssize_t>(bytes.size()));
  const std::string path = "/proc/self/fd/" + std::to_string(memory);
  const auto file = prepared::CellFile::open(path);
  if (file)
    read_all(*file);
  else
    must(!file.error().what.empty() && file.error().file == path);
  return 0;
}
