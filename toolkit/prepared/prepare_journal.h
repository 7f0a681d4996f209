// Journal of a preparation, for going on after a stop. The file only grows, by records that each have a hash.
// A record half written is none.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <palpate/result.h>
#include "toolkit/prepared/cell_file.h"
#include "toolkit/prepared/cell_partition.h"
#include "toolkit/prepared/scratch_files.h"

namespace palpate::prepared {

/// The input, the options and the machine's start: a run goes on only with its own. After a restart of the
/// machine, what was written last may not have reached the disk.
struct JournalKey {
  std::uint64_t hash = 0;
  /// True for inputs that cannot be recognised again.
  bool unknown = false;
  bool operator==(const JournalKey&) const = default;
};
/// `choices` hashes the options. A folder's files are its input; without a path the input is unknown.
[[nodiscard]] JournalKey make_journal_key(const std::string& input_path, std::uint64_t choices);

/// The finished steps, in their order: points scattered, chunks sorted and cut, cells written.
struct PrepareState {
  bool scattered = false;
  CellFileInfo info;  ///< points, dropped, bounds and lattice are known once scattered
  std::vector<CountedNode> nodes;
  std::vector<Region> regions;
  std::uint32_t chunks = 0;        ///< sorted
  std::vector<CellEntry> cut;      ///< cells of the sorted chunks
  std::vector<CellEntry> written;  ///< cells with their halos, in the file
};

/// Movable, not thread-safe.
class PrepareJournal {
 public:
  /// Reads what a run with the same key has left into `state`; else begins anew.
  [[nodiscard]] static Result<PrepareJournal> open(const std::string& path, const JournalKey& key,
                                                   PrepareState& state);
  /// Forgets everything: `state` becomes empty.
  [[nodiscard]] Status clear(PrepareState& state);
  // Each adds to the state and to the file.
  [[nodiscard]] Status scattered(PrepareState& state);
  [[nodiscard]] Status sorted_chunk(PrepareState& state, const std::vector<CellEntry>& cells);
  [[nodiscard]] Status wrote(PrepareState& state, const std::vector<CellEntry>& cells);
  /// Forgets the written cells, whose file is gone.
  [[nodiscard]] Status write_again(PrepareState& state);
  void remove() const noexcept { file_.remove(); }

 private:
  enum class Kind : std::uint32_t { kKey = 1, kScattered, kSortedChunk, kWrote, kWriteAgain };
  PrepareJournal(PartFile file, const JournalKey& key) : file_(std::move(file)), key_(key) {}
  [[nodiscard]] Status add(Kind kind, const std::vector<std::byte>& payload);
  [[nodiscard]] Status add_cells(Kind kind, const std::vector<CellEntry>& cells);
  /// False: not a record that can follow.
  [[nodiscard]] bool replay(std::uint32_t kind, std::span<const std::byte> payload,
                            PrepareState& state) const;

  PartFile file_;
  JournalKey key_;
  std::uint64_t end_ = 0;
};

}  // namespace palpate::prepared
