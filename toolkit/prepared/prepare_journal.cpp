#include "toolkit/prepared/prepare_journal.h"

#include <sys/stat.h>

#include <filesystem>

#include "toolkit/core/bytes.h"
#include "toolkit/core/hash.h"
#include "toolkit/io/point_stream.h"

namespace palpate::prepared {
namespace {

/// Kind, length of the payload; the hash follows the payload.
constexpr std::size_t kRecordHeadBytes = sizeof(std::uint32_t) + sizeof(std::uint64_t);
constexpr std::size_t kRecordEndBytes = sizeof(std::uint64_t);
constexpr std::size_t kNodeBytes = 4 * sizeof(std::uint64_t);
constexpr std::size_t kRegionBytes = 2 * sizeof(std::uint64_t) + 2 * sizeof(std::uint32_t);
/// Counts of points, dropped points, nodes, regions; bounds; lattice.
constexpr std::size_t kPlanHeadBytes = (4 + 6 + 4) * sizeof(std::uint64_t);

/// Every key has it, so that a journal of another layout is not understood as one of this.
constexpr std::uint64_t kJournalVersion = 2;

std::vector<std::byte> encode_plan(const PrepareState& state) {
  std::vector<std::byte> bytes(kPlanHeadBytes + state.nodes.size() * kNodeBytes +
                               state.regions.size() * kRegionBytes);
  ByteWriter writer{std::span(bytes)};
  writer.u64(state.info.points);
  writer.u64(state.info.dropped);
  writer.u64(state.nodes.size());
  writer.u64(state.regions.size());
  writer.vec(state.info.bounds_mm.low_mm);
  writer.vec(state.info.bounds_mm.high_mm);
  writer.i64(state.info.lattice.unit_exponent);
  for (const double first : state.info.lattice.first) writer.real(first);
  for (const CountedNode& node : state.nodes) {
    writer.u64(node.key.high);
    writer.u64(node.key.low);
    writer.i64(node.depth);
    writer.u64(node.points);
  }
  for (const Region& region : state.regions) {
    writer.u64(region.first);
    writer.u64(region.points);
    writer.u32(region.first_node);
    writer.u32(region.past_node);
  }
  return bytes;
}

bool decode_plan(std::span<const std::byte> bytes, PrepareState& state) {
  ByteReader reader(bytes);
  state.info.points = reader.u64();
  state.info.dropped = reader.u64();
  const std::uint64_t nodes = reader.u64(), regions = reader.u64();
  state.info.bounds_mm.low_mm = reader.vec();
  state.info.bounds_mm.high_mm = reader.vec();
  state.info.lattice.unit_exponent = static_cast<int>(reader.i64());
  for (double& first : state.info.lattice.first) first = reader.real();
  if (!reader.good() || nodes > reader.left() / kNodeBytes || regions > reader.left() / kRegionBytes)
    return false;
  state.nodes.resize(static_cast<std::size_t>(nodes));
  for (CountedNode& node : state.nodes) {
    node.key.high = reader.u64();
    node.key.low = reader.u64();
    node.depth = static_cast<int>(reader.i64());
    node.points = reader.u64();
  }
  state.regions.resize(static_cast<std::size_t>(regions));
  for (Region& region : state.regions) {
    region.first = reader.u64();
    region.points = reader.u64();
    region.first_node = reader.u32();
    region.past_node = reader.u32();
  }
  return reader.good() && reader.left() == 0;
}

void append_cells(std::span<const std::byte> bytes, std::vector<CellEntry>& cells) {
  ByteReader reader(bytes);
  while (reader.left() >= kCellEntryBytes) cells.push_back(read_cell_entry(reader));
}

std::uint64_t record_hash(std::span<const std::byte> head_and_payload) noexcept {
  Hash64 hash;
  hash.bytes(head_and_payload);
  return hash.value();
}

}  // namespace

JournalKey make_journal_key(const std::string& input_path, std::uint64_t choices) {
  Hash64 hash;
  hash.u64(kJournalVersion);
  hash.u64(choices);
  std::vector<std::string> paths{input_path};
  std::error_code failed;
  if (std::filesystem::is_directory(input_path, failed)) {
    Result<std::vector<std::string>> files = io::files_of_folder(input_path);
    if (!files) return {hash.value(), true};
    paths = *std::move(files);
  }
  constexpr std::uint64_t kMostBootBytes = 256;  // a name of 36 letters
  const Result<std::string> boot = read_file("/proc/sys/kernel/random/boot_id", kMostBootBytes);
  if (!boot) return {hash.value(), true};
  hash.bytes(std::as_bytes(std::span(*boot)));
  for (const std::string& path : paths) {
    struct stat status {};
    if (::stat(path.c_str(), &status) != 0) return {hash.value(), true};
    hash.bytes(std::as_bytes(std::span(path)));
    hash.u64(static_cast<std::uint64_t>(status.st_size));
    hash.u64(static_cast<std::uint64_t>(status.st_mtim.tv_sec));
    hash.u64(static_cast<std::uint64_t>(status.st_mtim.tv_nsec));
  }
  return {hash.value(), false};
}

bool PrepareJournal::replay(std::uint32_t kind, std::span<const std::byte> payload,
                            PrepareState& state) const {
  switch (static_cast<Kind>(kind)) {
    case Kind::kKey:
      return false;
    case Kind::kScattered:
      if (state.scattered || !decode_plan(payload, state)) return false;
      state.scattered = true;
      return true;
    case Kind::kSortedChunk:
      append_cells(payload, state.cut);
      ++state.chunks;
      return state.scattered;
    case Kind::kWrote:
      append_cells(payload, state.written);
      return state.written.size() <= state.cut.size();
    case Kind::kWriteAgain:
      state.written.clear();
      return true;
  }
  return false;
}

Result<PrepareJournal> PrepareJournal::open(const std::string& path, const JournalKey& key,
                                            PrepareState& state) {
  PALPATE_ASSIGN(PartFile file, PartFile::open(path));
  PALPATE_ASSIGN(const std::uint64_t size, file.size());
  PrepareJournal journal(std::move(file), key);
  state = {};
  bool good = !key.unknown;
  while (good) {
    std::vector<std::byte> record(kRecordHeadBytes);
    if (size - journal.end_ < kRecordHeadBytes + kRecordEndBytes) break;
    PALPATE_TRY(journal.file_.read_at(journal.end_, record));
    ByteReader head{std::span<const std::byte>(record)};
    const std::uint32_t kind = head.u32();
    const std::uint64_t payload_bytes = head.u64();
    if (payload_bytes > size - journal.end_ - kRecordHeadBytes - kRecordEndBytes) break;
    record.resize(kRecordHeadBytes + static_cast<std::size_t>(payload_bytes) + kRecordEndBytes);
    PALPATE_TRY(journal.file_.read_at(journal.end_, record));
    const std::span<const std::byte> all(record);
    ByteReader end(all.last(kRecordEndBytes));
    if (end.u64() != record_hash(all.first(all.size() - kRecordEndBytes))) break;
    const auto payload = all.subspan(kRecordHeadBytes, static_cast<std::size_t>(payload_bytes));
    if (journal.end_ == 0) {
      ByteReader reader(payload);
      good = kind == static_cast<std::uint32_t>(Kind::kKey) && reader.u64() == key.hash;
    } else {
      good = journal.replay(kind, payload, state);
    }
    if (good) journal.end_ += record.size();
  }
  if (!good || journal.end_ == 0)
    PALPATE_TRY(journal.clear(state));
  else
    PALPATE_TRY(journal.file_.resize(journal.end_));
  return journal;
}

Status PrepareJournal::clear(PrepareState& state) {
  state = {};
  end_ = 0;
  PALPATE_TRY(file_.resize(0));
  std::vector<std::byte> payload(sizeof(std::uint64_t));
  ByteWriter{std::span(payload)}.u64(key_.hash);
  return add(Kind::kKey, payload);
}

Status PrepareJournal::add(Kind kind, const std::vector<std::byte>& payload) {
  std::vector<std::byte> record(kRecordHeadBytes + payload.size() + kRecordEndBytes);
  ByteWriter writer{std::span(record)};
  writer.u32(static_cast<std::uint32_t>(kind));
  writer.u64(payload.size());
  writer.raw(payload);
  writer.u64(record_hash(std::span(record).first(kRecordHeadBytes + payload.size())));
  PALPATE_TRY(file_.write_at(end_, record));
  end_ += record.size();
  return Done{};
}

Status PrepareJournal::add_cells(Kind kind, const std::vector<CellEntry>& cells) {
  std::vector<std::byte> bytes(cells.size() * kCellEntryBytes);
  ByteWriter writer{std::span(bytes)};
  for (const CellEntry& cell : cells) write_cell_entry(writer, cell);
  return add(kind, bytes);
}

Status PrepareJournal::scattered(PrepareState& state) {
  state.scattered = true;
  return add(Kind::kScattered, encode_plan(state));
}

Status PrepareJournal::sorted_chunk(PrepareState& state, const std::vector<CellEntry>& cells) {
  state.cut.insert(state.cut.end(), cells.begin(), cells.end());
  ++state.chunks;
  return add_cells(Kind::kSortedChunk, cells);
}

Status PrepareJournal::wrote(PrepareState& state, const std::vector<CellEntry>& cells) {
  state.written.insert(state.written.end(), cells.begin(), cells.end());
  return add_cells(Kind::kWrote, cells);
}

Status PrepareJournal::write_again(PrepareState& state) {
  state.written.clear();
  return add(Kind::kWriteAgain, {});
}

}  // namespace palpate::prepared
