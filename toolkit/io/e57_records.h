// The binary section of one scan of an E57 file (ASTM E2807): packets that hold a piece of each field's
// stream of bits.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <palpate/result.h>
#include "toolkit/io/e57_pages.h"
#include "toolkit/io/e57_scans.h"

namespace palpate::io {

/// Where one field's stream stands. Streams need not advance alike: a packet may hold much of one and none of
/// another, so each goes through the packets for itself.
struct E57Cursor {
  std::size_t field = 0;           ///< in the prototype
  std::uint64_t next_packet = 0;   ///< logical offset
  std::vector<std::byte> bytes{};  ///< of the stream, not taken yet, and some zeros behind
  std::size_t length = 0;          ///< of `bytes` without the zeros
  std::size_t bit = 0;             ///< the first of `bytes` that is not taken
};

/// Values of chosen fields from the first record to the last. Holds one packet and for each chosen field at
/// most one more, 64 KiB each. `pages` and `scan` are kept alive by the caller.
class E57Records {
 public:
  /// Checks the section's header and that the promised records fit its bytes. `wanted` are numbers.
  [[nodiscard]] static Result<E57Records> open(E57Pages& pages, const E57Scan& scan,
                                               const std::vector<std::size_t>& wanted);

  [[nodiscard]] std::uint64_t left() const noexcept { return scan_->records - taken_; }
  /// The next records, at most `most` and as many as the loaded packets hold of all fields: columns[i] gets
  /// the values of the i-th wanted field. Returns how many, 0 only at the end.
  [[nodiscard]] Result<std::size_t> next(std::size_t most, std::span<std::vector<double>> columns);

 private:
  E57Records(E57Pages& pages, const E57Scan& scan) : pages_(&pages), scan_(&scan) {}
  Status check_section();
  Result<bool> load_packet(std::uint64_t at);
  Status advance(E57Cursor& cursor);
  void take(E57Cursor& cursor, std::span<double> values) const;

  E57Pages* pages_;
  const E57Scan* scan_;
  std::vector<E57Cursor> cursors_;
  std::uint64_t begin_ = 0;  // of the packets, logical
  std::uint64_t end_ = 0;
  std::uint64_t taken_ = 0;
  std::vector<std::byte> packet_;
  std::uint64_t packet_at_ = 0;  // 0: none is loaded, as the file's header stands there
};

}  // namespace palpate::io
