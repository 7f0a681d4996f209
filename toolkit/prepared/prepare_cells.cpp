#include "toolkit/prepared/prepare.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <utility>
#include <vector>

#include "toolkit/core/hash.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/prepared/cell_halo.h"
#include "toolkit/prepared/cell_partition.h"
#include "toolkit/prepared/point_passes.h"
#include "toolkit/prepared/prepare_journal.h"

namespace palpate::prepared {
namespace {

/// The counting grid with its sums and regions (40 MB), two batches of points with their places (20 MB), and
/// the program itself.
constexpr std::uint64_t kFixedBytes = std::uint64_t{96} << 20;
constexpr std::uint64_t kScatterBufferBytes = std::uint64_t{64} << 20;
/// Cells kept for their neighbours' halos: a row of cells across a large scan.
constexpr std::uint64_t kMostHaloBytes = std::uint64_t{256} << 20;
/// Per cell: the table twice, and its box in a tree; cells have a thousand points at least where the quantum
/// does not divide them, so a quarter of a byte per point.
constexpr std::uint64_t kPointsPerTableByte = 4;
constexpr std::uint64_t kTableBytesPerCell = 2 * sizeof(CellEntry) + 2 * sizeof(geometry::Aabb);
/// Below it chunks would be smaller than what is made at once.
constexpr std::uint64_t kLeastWorkBytes = std::uint64_t{32} << 20;
constexpr NumberRange kHaloWidths{0.0, 64.0};  // a cell is about 64 spacings wide

/// Points sorted at once.
struct Chunk {
  std::uint64_t first = 0, points = 0;
  std::uint32_t region = 0;
};

Error stopped() {
  return Error{"preparing was stopped", "run it again to go on"};
}

Status check_options(const PrepareCellsOptions& options) {
  const auto inside = [](double value, const NumberRange& range) {
    return value <= range.high && (range.above_low ? value > range.low : value >= range.low);
  };
  const auto refused = [&](const char* what, const NumberRange& range) {
    return Error{fmt::format("{} must be {}", what, text_of(range)), "give another number"};
  };
  if (!inside(options.mm_per_unit, kScales)) return refused("the unit in mm", kScales);
  if (!inside(options.quantum_mm, kLengthsMm)) return refused("the quantum in mm", kLengthsMm);
  if (!inside(options.halo_spacings, kHaloWidths)) return refused("the halo in spacings", kHaloWidths);
  if (options.memory_bytes < kFixedBytes + kLeastWorkBytes)
    return over_memory_limit("preparing points", options.memory_bytes);
  return Done{};
}

std::string scratch_stem(const PrepareCellsOptions& options, const std::string& path) {
  if (options.scratch_folder.empty()) return path;
  // Files of one name in different folders have scratch files of different names.
  std::error_code error;
  const std::filesystem::path whole = std::filesystem::absolute(path, error);
  Hash64 hash;
  const std::string text = whole.string();
  hash.bytes(std::as_bytes(std::span(text)));
  return (std::filesystem::path(options.scratch_folder) / (whole.filename().string() + "-" + hash.hex()))
      .string();
}

std::uint64_t hash_of_choices(const PrepareCellsOptions& options, const io::StreamHeader& header) {
  Hash64 hash;
  for (const double number : {options.mm_per_unit, options.quantum_mm, options.halo_spacings})
    hash.real(number);
  hash.u64(options.memory_bytes);
  hash.u64(options.most_chunk_points);
  hash.u64(header.points);
  hash.bytes(std::as_bytes(std::span(header.format)));
  return hash.value();
}

class Preparation {
 public:
  Preparation(io::PointStream& stream, const PrepareCellsOptions& options, std::string path,
              Progress& progress, PrepareJournal journal, PartFile scratch_file, PrepareState state)
      : options_(&options),
        path_(std::move(path)),
        progress_(&progress),
        passes_(stream, options.mm_per_unit, options.threads, progress),
        journal_(std::move(journal)),
        scratch_file_(std::move(scratch_file)),
        state_(std::move(state)) {}

  Result<PrepareCellsReport> run() {
    PALPATE_ASSIGN(const std::uint64_t there, scratch_file_.size());
    if (state_.scattered && there != scratch().bytes(state_.info.points)) PALPATE_TRY(journal_.clear(state_));
    report_.resumed = state_.scattered;
    if (!state_.scattered) PALPATE_TRY(scatter());
    report_.scratch_bytes = scratch().bytes(state_.info.points);
    PALPATE_TRY(sort_chunks());
    PALPATE_TRY(write_cells());
    report_.passes = passes_.passes();
    report_.chunks = chunks().size();
    report_.info = state_.info;
    remove();
    return report_;
  }
  void remove() const noexcept {
    journal_.remove();
    scratch_file_.remove();
  }

 private:
  [[nodiscard]] std::uint64_t work_bytes(std::uint64_t points) const noexcept {
    const std::uint64_t fixed = kFixedBytes + points / kPointsPerTableByte;
    return options_->memory_bytes > fixed ? options_->memory_bytes - fixed : 0;
  }
  /// Points that a chunk may hold: a multiple of kMostCellPoints, so that cutting equal points gives the same
  /// cells. At most half of all, to keep the scratch file small.
  [[nodiscard]] std::uint64_t most_chunk_points(std::uint64_t points) const noexcept {
    const std::uint64_t most = std::min(
        {options_->most_chunk_points, points / 2 + kMostCellPoints, work_bytes(points) / kSortBytesPerPoint});
    return std::max<std::uint64_t>(most / kMostCellPoints, 1) * kMostCellPoints;
  }
  /// Bytes left for the table beside a chunk at work.
  [[nodiscard]] std::uint64_t most_table_bytes() const noexcept {
    return options_->memory_bytes - kFixedBytes - most_chunk_points(state_.info.points) * kSortBytesPerPoint;
  }
  [[nodiscard]] std::vector<Chunk> chunks() const {
    const std::uint64_t most = most_chunk_points(state_.info.points);
    std::vector<Chunk> all;
    for (std::uint32_t r = 0; r < state_.regions.size(); ++r) {
      const Region& region = state_.regions[r];
      for (std::uint64_t i = 0; i < region.points; i += most)
        all.push_back({region.first + i, std::min(most, region.points - i), r});
    }
    return all;
  }
  [[nodiscard]] PointScratch scratch() const {
    std::uint64_t most = 0;
    for (const Chunk& chunk : chunks()) most = std::max(most, chunk.points);
    return {scratch_file_, most};
  }
  Status scatter();
  Result<PassFindings> count(CountTree& tree);
  Status sort_chunks();
  [[nodiscard]] Result<bool> written_are_there(const PartFile& file) const;
  Status write_cells();
  Status finish(PartFile& file);

  const PrepareCellsOptions* options_;
  std::string path_;
  Progress* progress_;
  PointPasses passes_;
  PrepareJournal journal_;
  PartFile scratch_file_;
  PrepareState state_;
  PrepareCellsReport report_;
};

/// The header's bounds save a pass where they give the lattice that the points' own give.
Result<PassFindings> Preparation::count(CountTree& tree) {
  CellLattice& lattice = state_.info.lattice;
  const std::optional<geometry::Aabb> promised = passes_.promised_bounds_mm();
  std::optional<CellLattice> guess;
  if (promised) guess = CellLattice::over(*promised);
  PALPATE_ASSIGN(PassFindings first, passes_.count(guess, tree));
  lattice = CellLattice::over(first.bounds_mm);
  if (guess == lattice || first.points == 0) return first;
  tree = CountTree(first.points);
  PALPATE_ASSIGN(const PassFindings second, passes_.count(lattice, tree));
  if (second.points != first.points || second.outside != 0) return PointPasses::changed();
  return first;
}

Status Preparation::scatter() {
  CountTree tree(passes_.promised_points());
  PALPATE_ASSIGN(const PassFindings found, count(tree));
  CellFileInfo& info = state_.info;
  info.points = found.points;
  info.dropped = found.dropped;
  info.bounds_mm = found.bounds_mm;
  if (info.lattice.unit_mm() > options_->quantum_mm)
    return Error{fmt::format("points over {} mm cannot be stored in steps of {} mm",
                             format_number(info.bounds_mm.extent_mm().maxCoeff()),
                             format_number(options_->quantum_mm)),
                 "remove the points far away, or allow a larger quantum"};
  if (work_bytes(info.points) < kLeastWorkBytes)
    return over_memory_limit(fmt::format("preparing {} points", format_count(info.points)),
                             options_->memory_bytes);
  const std::uint64_t most = most_chunk_points(info.points);
  while (tree.divide_crowded(most)) {
    PALPATE_ASSIGN(const PassFindings again, passes_.count(info.lattice, tree));
    if (again.points != found.points) return PointPasses::changed();
  }
  if (!tree.make_regions(most)) return PointPasses::changed();
  state_.nodes = tree.nodes();
  state_.regions = tree.regions();
  PointScratch into = scratch();
  const auto buffers = static_cast<std::size_t>(std::min(kScatterBufferBytes, work_bytes(info.points)));
  PALPATE_TRY(into.begin_scatter(state_.regions, buffers));
  PALPATE_TRY(passes_.scatter(info.lattice, tree, into));
  return journal_.scattered(state_);
}

Status Preparation::sort_chunks() {
  const std::vector<Chunk> all = chunks();
  const PointScratch points_file = scratch();
  const CutRules rules{state_.info.lattice, options_->quantum_mm, options_->halo_spacings};
  std::vector<PackedPoint> points;
  while (state_.chunks < all.size()) {
    if (progress_->cancelled()) return stopped();
    progress_->report("sorting points", static_cast<double>(state_.chunks) / static_cast<double>(all.size()));
    const Chunk& chunk = all[state_.chunks];
    const Region& region = state_.regions[chunk.region];
    points.resize(static_cast<std::size_t>(chunk.points));
    PALPATE_TRY(points_file.read_scattered(chunk.first, points));
    sort_points(points, options_->threads);
    PALPATE_TRY(points_file.write_sorted(chunk.first, points));
    std::vector<CountedNode> nodes(state_.nodes.begin() + region.first_node,
                                   state_.nodes.begin() + region.past_node);
    // A region in several chunks is one node, of equal points.
    if (chunk.points != region.points) nodes.front().points = chunk.points;
    PALPATE_TRY(journal_.sorted_chunk(state_, cut_cells(points, nodes, rules, options_->threads)));
    if (state_.cut.size() * kTableBytesPerCell > most_table_bytes())
      return over_memory_limit(
          fmt::format("a quantum of {} mm, which gives over {} cells,", format_number(options_->quantum_mm),
                      format_count(state_.cut.size())),
          options_->memory_bytes);
  }
  return Done{};
}

/// False if the file is not the one that the journal tells of: another run may have written it since.
Result<bool> Preparation::written_are_there(const PartFile& file) const {
  PALPATE_ASSIGN(const std::uint64_t size, file.size());
  std::vector<std::byte> bytes;
  for (const CellEntry& entry : state_.written) {
    if (size < entry.offset + entry.bytes()) return false;
    bytes.resize(static_cast<std::size_t>(entry.bytes()));
    PALPATE_TRY(file.read_at(entry.offset, bytes));
    Hash64 hash;
    hash.bytes(bytes);
    if (hash.value() != entry.hash) return false;
  }
  return true;
}

Status Preparation::write_cells() {
  PALPATE_ASSIGN(PartFile file, PartFile::open(path_ + ".part"));
  PALPATE_ASSIGN(const bool kept, written_are_there(file));
  if (!kept) PALPATE_TRY(journal_.write_again(state_));
  if (state_.written.empty()) PALPATE_TRY(file.resize(0));
  std::uint64_t offset = kCellHeaderBytes;
  for (const CellEntry& entry : state_.written) offset += entry.bytes();
  const PointScratch points_file = scratch();
  const std::uint64_t memory = std::min(
      kMostHaloBytes, (options_->memory_bytes - kFixedBytes - state_.cut.size() * kTableBytesPerCell) / 2);
  HaloMaker maker(state_.cut, state_.info.lattice, points_file, static_cast<std::size_t>(memory),
                  options_->threads);
  std::vector<std::byte> bytes;
  std::vector<CellEntry> entries;
  while (state_.written.size() < state_.cut.size()) {
    if (progress_->cancelled()) return stopped();
    progress_->report("writing cells",
                      static_cast<double>(state_.written.size()) / static_cast<double>(state_.cut.size()));
    PALPATE_ASSIGN(const auto made, maker.make_from(state_.written.size()));
    bytes.clear();
    entries.clear();
    for (const HaloMaker::MadeCell& cell : made) {
      entries.push_back(cell.entry);
      entries.back().offset = offset + bytes.size();
      bytes.insert(bytes.end(), cell.bytes.begin(), cell.bytes.end());
    }
    PALPATE_TRY(file.write_at(offset, bytes));
    offset += bytes.size();
    PALPATE_TRY(journal_.wrote(state_, entries));
  }
  return finish(file);
}

Status Preparation::finish(PartFile& file) {
  CellFileInfo& info = state_.info;
  info.cells = state_.written.size();
  info.halo_points = 0;
  info.asked_quantum_mm = options_->quantum_mm;
  info.halo_spacings = options_->halo_spacings;
  info.mm_per_unit = options_->mm_per_unit;
  info.quantum_mm = 0.0;
  std::uint64_t offset = kCellHeaderBytes;
  std::vector<std::byte> table(state_.written.size() * kCellEntryBytes);
  ByteWriter writer{std::span(table)};
  for (const CellEntry& entry : state_.written) {
    info.halo_points += entry.halo;
    info.quantum_mm = std::max(info.quantum_mm, std::ldexp(info.lattice.unit_mm(), entry.shift));
    offset += entry.bytes();
    write_cell_entry(writer, entry);
  }
  Hash64 hash;
  hash.bytes(table);
  PALPATE_TRY(file.write_at(offset, table));
  PALPATE_TRY(file.write_at(0, encode_cell_header(info, offset, hash.value())));
  report_.file_bytes = offset + table.size();
  // A longer one may have been left by a run that was stopped here.
  PALPATE_TRY(file.resize(report_.file_bytes));
  return file.rename_to(path_);
}

}  // namespace

Result<PrepareCellsReport> prepare_cells(io::PointStream& stream, const PrepareCellsOptions& options,
                                         const std::string& path, Progress& progress) {
  if (Status checked = check_options(options); !checked)
    return std::move(checked).error().in_file(options.input_path);
  const JournalKey key = make_journal_key(options.input_path, hash_of_choices(options, stream.header()));
  const std::string stem = scratch_stem(options, path);
  PrepareState state;
  PALPATE_ASSIGN(PrepareJournal journal, PrepareJournal::open(stem + ".journal", key, state));
  PALPATE_ASSIGN(PartFile scratch, PartFile::open(stem + ".scratch"));
  Preparation preparation(stream, options, path, progress, std::move(journal), std::move(scratch),
                          std::move(state));
  Result<PrepareCellsReport> report = preparation.run();
  if (report) return report;
  // A file that no run can continue is removed.
  if (key.unknown) {
    preparation.remove();
    std::error_code error;
    std::filesystem::remove(path + ".part", error);
  }
  return std::move(report).error().in_file(options.input_path);
}

}  // namespace palpate::prepared
