// Fuzzes bridge datagrams: decoded ones encode to the same bytes, and neither side gives a force for them.
// The first is used as it is and with a corrected CRC.
#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "device/bridge/bridge_device.h"
#include "device/bridge/bridge_server.h"
#include "tests/fuzz/must.h"

namespace palpate::device {
namespace {

class OneDatagram final : public Link, public DatagramPort {
 public:
  explicit OneDatagram(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}
  Status open() override { return Done{}; }
  void close() noexcept override {}
  bool submit(std::span<const std::uint8_t> bytes) noexcept override {
    must(decoded_datagram(bytes).has_value());
    return true;
  }
  Polled poll(std::span<std::uint8_t> into) noexcept override { return {copied(into), false}; }
  std::size_t receive(std::span<std::uint8_t> into, Peer& from) noexcept override {
    from.size = 1;
    return copied(into);
  }
  bool send(std::span<const std::uint8_t> bytes, const Peer&) noexcept override { return submit(bytes); }

 private:
  std::size_t copied(std::span<std::uint8_t> into) const noexcept {
    const std::size_t size = std::min(into.size(), bytes_.size());
    std::copy_n(bytes_.begin(), size, into.begin());
    return size;
  }
  std::span<const std::uint8_t> bytes_;
};

class NoForce final : public Device {
 public:
  [[nodiscard]] std::string name() const override { return "none"; }
  [[nodiscard]] Status open() override { return Done{}; }
  void close() noexcept override {}
  [[nodiscard]] DeviceLimits limits() const noexcept override {
    return {1.0, {Vec3::Constant(-1.0), Vec3::Constant(1.0)}, 0.01, 1000.0};
  }
  [[nodiscard]] DeviceState read() noexcept override { return {}; }
  void send(GovernedForce force) noexcept override { must(force.newtons().isZero(0.0)); }
};

void feed(std::span<const std::uint8_t> bytes) {
  if (const auto datagram = decoded_datagram(bytes)) {
    const DatagramBytes again(*datagram);
    must(std::equal(bytes.begin(), bytes.end(), again.bytes().begin(), again.bytes().end()));
  }
  VirtualClock clock;
  OneDatagram port(bytes);
  NoForce motors;
  BridgeServer far(motors, port, clock, {});
  must(far.open().ok());
  for (int i = 0; i < 3; ++i) {
    far.tick();
    clock.advance(1e-3);
  }
  BridgeOptions options;
  options.open_tries = 2;
  options.wait = [&clock] { clock.advance(1e-3); };
  auto owned = std::make_unique<OneDatagram>(bytes);
  BridgeDevice host(std::move(owned), clock, options);
  must(!host.open().ok());  // one datagram cannot make the far end obey
}

}  // namespace
}  // namespace palpate::device

extern "C" int palpate_fuzz_bridge(const std::uint8_t* data, std::size_t size) {
  using namespace palpate::device;
  const std::span<const std::uint8_t> bytes(data, size);
  feed(bytes);
  constexpr std::size_t kCrc = 4;
  if (size < kCrc || size > kMaxDatagramBytes) return 0;
  std::vector<std::uint8_t> repaired(bytes.begin(), bytes.end());
  const std::uint32_t crc = crc32_of(bytes.first(size - kCrc));
  for (std::size_t i = 0; i < kCrc; ++i)
    repaired[size - kCrc + i] = static_cast<std::uint8_t>((crc >> (8U * i)) & 0xFFU);
  feed(repaired);
  return 0;
}

#ifdef PALPATE_FUZZING
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return palpate_fuzz_bridge(data, size);
}
#endif
