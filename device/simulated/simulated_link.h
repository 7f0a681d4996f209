// A link without hardware: packets of a hand that moves by a script, on any clock, to and from a simulated
// board, and everything that goes wrong on a cable.
#pragma once

#include <cstdint>
#include <vector>

#include "device/interface/link.h"
#include "device/simulated/hand_script.h"
#include "device/simulated/packets.h"
#include "device/simulated/simulated_board.h"
#include "toolkit/core/clock.h"
#include "toolkit/core/random.h"

namespace palpate::device {

/// Something that goes wrong from `start_s` on (time since open) for `duration_s`.
struct LinkFault {
  enum class Kind : std::uint8_t {
    kSilent,      ///< nothing comes
    kShort,       ///< of each packet only the first half
    kGarbled,     ///< bits of each packet are flipped, anywhere in it
    kLate,        ///< each packet comes `late_s` after its time
    kLost,        ///< of `of` packets one comes
    kDuplicated,  ///< the last packet before it comes again and again
    kUnplugged,   ///< the link is gone
    kUnhomed,     ///< the device has forgotten where its zero is
    kJump,        ///< the position is off by `jump_mm`
  };
  Kind kind = Kind::kSilent;
  double start_s = 0.0;
  double duration_s = 0.0;
  double late_s = 0.030;
  std::uint32_t of = 1000;
  Vec3 jump_mm = Vec3{60.0, 0.0, 0.0};
};

struct SimulatedLinkOptions {
  double rate_hz = 1000.0;  ///< packets that the device makes in a second
  double mm_per_count = 0.01;
  std::uint8_t flags = Packet::kHomed;
  std::uint64_t seed = 1;
};

/// Keeps references to board, script and clock. poll by one thread, submit by any. No allocation but in the
/// constructor.
class SimulatedLink final : public Link {
 public:
  SimulatedLink(SimulatedBoard& board, const HandScript& script, const Clock& clock,
                const SimulatedLinkOptions& options = {}, std::vector<LinkFault> faults = {});

  [[nodiscard]] Status open() override;
  void close() noexcept override;
  bool submit(std::span<const std::uint8_t> bytes) noexcept override;
  [[nodiscard]] Polled poll(std::span<std::uint8_t> into) noexcept override;

 private:
  [[nodiscard]] const LinkFault* fault_at(double t_s) const noexcept;
  [[nodiscard]] Packet packet_of(std::int64_t index, const LinkFault* fault) const noexcept;
  [[nodiscard]] std::size_t spoiled(PacketBytes& bytes, const LinkFault* fault) noexcept;

  SimulatedBoard& board_;
  const HandScript& script_;
  const Clock& clock_;
  SimulatedLinkOptions options_;
  std::vector<LinkFault> faults_;
  Random random_;
  std::atomic<bool> open_{false};
  double opened_s_ = 0.0;
  std::int64_t newest_ = -1;  // packet that went out last
  PacketBytes last_{};
};

}  // namespace palpate::device
