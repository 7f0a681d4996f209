// Fuzzes a link in pieces of any size: packets found must match the bytes, and the device must stay sane.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <span>
#include <vector>

#include "device/simulated/packet_device.h"
#include "tests/fuzz/must.h"

namespace palpate::device {
namespace {

/// Gives the input in pieces whose sizes are bytes of it.
class PiecesLink final : public Link {
 public:
  explicit PiecesLink(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}
  Status open() override { return Done{}; }
  void close() noexcept override {}
  bool submit(std::span<const std::uint8_t> bytes) noexcept override {
    if (bytes.size() != kPacketBytes || !decoded(bytes.first<kPacketBytes>())) std::abort();
    return true;
  }
  Polled poll(std::span<std::uint8_t> into) noexcept override {
    if (at_ == bytes_.size()) return {0, true};
    const std::size_t most = std::min(into.size(), bytes_.size() - at_);
    const std::size_t size = std::min<std::size_t>(most, 1U + bytes_[at_] % 32U);
    std::copy_n(bytes_.begin() + static_cast<std::ptrdiff_t>(at_), size, into.begin());
    at_ += size;
    return {size, false};
  }

 private:
  std::span<const std::uint8_t> bytes_;
  std::size_t at_ = 0;
};

/// The packets in the stream, left to right without overlap.
std::vector<Packet> scanned(std::span<const std::uint8_t> bytes) {
  std::vector<Packet> all;
  for (std::size_t i = 0; i + kPacketBytes <= bytes.size();) {
    const auto packet = decoded(bytes.subspan(i).first<kPacketBytes>());
    if (packet) all.push_back(*packet);
    i += packet ? kPacketBytes : 1;
  }
  return all;
}

}  // namespace
}  // namespace palpate::device

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate::device;
  using palpate::must;
  const std::span<const std::uint8_t> bytes(data, size);
  PacketReader reader;
  std::vector<Packet> found;
  std::uint64_t held = 0;
  for (const std::uint8_t byte : bytes) {
    const auto packet = reader.take(byte);
    if (!packet) continue;
    must(encoded(*packet) == reader.bytes() && reader.malformed_in_a_row() == 0);
    found.push_back(*packet);
  }
  held = bytes.size() - kPacketBytes * found.size() - reader.dropped();
  must(found == scanned(bytes) && held < kPacketBytes);

  const palpate::VirtualClock clock;
  PiecesLink link(bytes);
  PacketDevice device(link, clock);
  must(device.open().ok());
  const double most_mm = 32768.0 * PacketDeviceOptions{}.mm_per_count;
  for (std::size_t frames = 0;; ++frames) {
    const DeviceState state = device.read();
    must(state.position_mm.cwiseAbs().maxCoeff() <= most_mm * 1.0000001 &&
         state.raw.size <= RawPacket::kMost);
    if (state.status == ReadStatus::kLost) break;
    must(frames <= bytes.size());
  }
  return 0;
}
