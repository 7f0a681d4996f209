#include "device/falcon/falcon_boot.h"

#include <algorithm>
#include <array>
#include <optional>
#include <utility>
#include <vector>

#include "device/falcon/falcon_packets.h"
#include "toolkit/core/try.h"

namespace palpate::device {
namespace {

constexpr const char* kFalconName = "falcon";

// FTDI's requests (application note AN232B-04 and public drivers).
constexpr std::uint8_t kVendorOut = 0x40;
constexpr std::uint8_t kPurge = 0x00, kModem = 0x01, kFlow = 0x02, kBaud = 0x03, kLine = 0x04, kEvent = 0x06,
                       kLatency = 0x09;
constexpr std::uint16_t kPurgeRx = 1, kPurgeTx = 2;
constexpr std::uint16_t kDtrLow = 0x0100, kDtrHigh = 0x0101, kRtsLow = 0x0200;
constexpr std::uint16_t kNoFlow = 0, kLine8N1 = 0x0008;
constexpr std::uint16_t kBaudRom = 0x4138, kBaudLoading = 0x0015, kBaudPackets = 0x0002;
constexpr std::uint16_t kLatencyLoading = 16, kLatencyPackets = 1;  // ms
constexpr std::uint16_t kEventOff = 0, kEventOn = 0x013E;           // '>', and the bit that enables it

constexpr std::size_t kMostPacket = 64;
constexpr std::size_t kChunk = 62;  // what one packet's echo can hold
constexpr std::uint8_t kAutobaud = 0x41;
constexpr std::array<std::uint8_t, 3> kHello = {0x0A, 0x43, 0x0D};
constexpr std::array<std::uint8_t, 4> kHelloAnswer = {0x0A, 0x44, 0x2C, 0x0D};

constexpr int kHelloTries = 100;
constexpr int kHelloMs = 50;    // 4 bytes at 9600 baud take 4 ms, the chip's timer 16
constexpr int kEchoMs = 250;    // 62 bytes take 5 ms and the timer 16; the rest is for a busy machine
constexpr int kSubmitMs = 250;  // for a queue that is full
constexpr int kUploads = 10;
// Replies may be lost: 10 rounds of 100 packets, each waited for 2 ms, twice what the chip's timer takes.
constexpr int kProbeRounds = 10, kProbeTries = 100, kProbeMs = 2;

/// The chip: requests, bytes out, payload in.
class FtdiLine {
 public:
  FtdiLine(ControlLink& link, const FalconBoot& boot) : link_(link), boot_(boot) {}

  Status set(std::uint8_t request, std::uint16_t value) {
    return link_.control({kVendorOut, request, value, 0});
  }
  Status purge() {
    PALPATE_TRY(set(kPurge, kPurgeRx));
    PALPATE_TRY(set(kPurge, kPurgeTx));
    // What the link holds already; bounded, for a device may talk without end.
    for (std::size_t i = 0; i < kMostStale && read().has_value(); ++i) payload_ = {};
    return gone_ ? Status(gone()) : Status(Done{});
  }
  Status write(std::span<const std::uint8_t> bytes) {
    for (int ms = 0; !link_.submit(bytes); ++ms) {
      if (gone_ || ms == kSubmitMs)
        return Error{"the Falcon takes no bytes", "unplug it, plug it in again, and look at its power",
                     kFalconName, 0};
      boot_.pause(1);
    }
    return Done{};
  }
  /// The next byte that has come.
  std::optional<std::uint8_t> read() {
    for (int packets = 0; payload_.empty() && packets < kMostEmptyPackets; ++packets) {
      const Polled polled = link_.poll(packet_);
      gone_ = gone_ || polled.gone;
      if (polled.size == 0) return std::nullopt;
      payload_ = ftdi_payload(std::span(packet_).first(polled.size));
    }
    if (payload_.empty()) return std::nullopt;
    const std::uint8_t byte = payload_.front();
    payload_ = payload_.subspan(1);
    return byte;
  }
  /// The same, waited for; `left_ms` counts down over several calls.
  std::optional<std::uint8_t> await(int& left_ms) {
    for (;;) {
      if (const auto byte = read()) return byte;
      if (gone_ || left_ms <= 0) return std::nullopt;
      boot_.pause(1);
      --left_ms;
    }
  }
  [[nodiscard]] bool is_gone() const { return gone_; }
  static Error gone() {
    return {"the Falcon was unplugged while it was being set up", "plug it in again", kFalconName, 0};
  }

 private:
  static constexpr std::size_t kMostStale = 4096;  // bytes: more than a link's ring holds
  static constexpr int kMostEmptyPackets = 64;     // a second's worth at 16 ms

  ControlLink& link_;
  const FalconBoot& boot_;
  std::array<std::uint8_t, kMostPacket> packet_{};
  std::span<const std::uint8_t> payload_;
  bool gone_ = false;
};

Status set_all(FtdiLine& line, std::initializer_list<std::pair<std::uint8_t, std::uint16_t>> settings) {
  for (const auto& [request, value] : settings) PALPATE_TRY(line.set(request, value));
  return Done{};
}

Status set_for_packets(FtdiLine& line, bool event_character) {
  PALPATE_TRY(set_all(line, {{kLatency, kLatencyPackets},
                             {kBaud, kBaudPackets},
                             {kLine, kLine8N1},
                             {kFlow, kNoFlow},
                             {kEvent, event_character ? kEventOn : kEventOff}}));
  return line.purge();
}

/// Whether packets are answered by packets.
Result<bool> firmware_runs(FtdiLine& line, const FalconBoot& boot) {
  const FalconBytes zero = encoded(FalconCommand{});
  for (int round = 0; round < kProbeRounds; ++round) {
    PALPATE_TRY(set_for_packets(line, boot.event_character));
    FalconReader reader;
    for (int tries = 0; tries < kProbeTries; ++tries) {
      PALPATE_TRY(line.write(zero));
      int left_ms = kProbeMs;
      while (const auto byte = line.await(left_ms))
        if (reader.take(*byte)) return true;
      if (line.is_gone()) return FtdiLine::gone();
    }
  }
  return false;
}

Error no_answer(const char* what) {
  return {std::string("the Falcon's boot ROM ") + what,
          "switch the Falcon off and on, and plug it in without a hub", kFalconName, 0};
}

/// Resets the processor and waits until its boot ROM answers.
Status wake_rom(FtdiLine& line) {
  PALPATE_TRY(set_all(line, {{kEvent, kEventOff},
                             {kLatency, kLatencyLoading},
                             {kBaud, kBaudRom},
                             {kLine, kLine8N1},
                             {kFlow, kNoFlow},
                             {kModem, kRtsLow},
                             {kModem, kDtrLow},
                             {kModem, kDtrHigh}}));
  PALPATE_TRY(line.purge());
  for (int tries = 0; tries < kHelloTries; ++tries) {
    PALPATE_TRY(line.write(kHello));
    int left_ms = kHelloMs;
    // Some hosts see a zero before the answer: only its end counts.
    std::size_t matched = 0;
    while (const auto byte = line.await(left_ms)) {
      matched = *byte == kHelloAnswer[matched] ? matched + 1 : (*byte == kHelloAnswer[0] ? 1U : 0U);
      if (matched == kHelloAnswer.size()) return Done{};
    }
    if (line.is_gone()) return FtdiLine::gone();
  }
  return no_answer("does not answer");
}

/// From the boot ROM's answer to the last byte of the image, each compared with its echo.
Status load(FtdiLine& line, const FalconFirmware& image) {
  PALPATE_TRY(set_all(line, {{kModem, kDtrLow}, {kBaud, kBaudLoading}}));
  PALPATE_TRY(line.purge());
  PALPATE_TRY(line.write(std::span(&kAutobaud, 1)));
  int left_ms = kEchoMs;
  for (;;) {  // late answers to a greeting may come first
    const auto byte = line.await(left_ms);
    if (!byte) return line.is_gone() ? FtdiLine::gone() : no_answer("does not take the rate for loading");
    if (*byte == kAutobaud) break;
  }
  const std::span<const std::uint8_t> bytes(image.bytes);
  for (std::size_t at = 0; at < bytes.size(); at += kChunk) {
    const std::span<const std::uint8_t> chunk = bytes.subspan(at, std::min(kChunk, bytes.size() - at));
    PALPATE_TRY(line.write(chunk));
    left_ms = kEchoMs;
    for (const std::uint8_t sent : chunk) {
      const auto echo = line.await(left_ms);
      if (!echo) return line.is_gone() ? FtdiLine::gone() : no_answer("stopped echoing the image");
      if (*echo != sent) return no_answer("echoed a byte of the image wrongly");
    }
  }
  return Done{};
}

}  // namespace

Result<FalconBooted> boot_falcon(ControlLink& link, const FalconBoot& boot) {
  FalconBooted booted;
  {
    FtdiLine line(link, boot);
    PALPATE_ASSIGN(booted.was_running, firmware_runs(line, boot));
    if (booted.was_running) return booted;
  }
  PALPATE_ASSIGN(const FalconFirmware image, boot.firmware());
  booted.firmware = image.name;
  booted.sha256 = image.sha256;
  for (;;) {
    ++booted.attempts;
    FtdiLine line(link, boot);
    Status loaded = wake_rom(line);
    if (loaded) loaded = load(line, image);
    if (loaded) {
      PALPATE_ASSIGN(const bool runs, firmware_runs(line, boot));
      if (runs) return booted;
      loaded = Error{"the image was loaded, but does not answer packets",
                     "try another image of the Falcon's firmware", image.path, 0};
    }
    if (line.is_gone() || booted.attempts == kUploads) return std::move(loaded).error();
    link.close();
    PALPATE_TRY(link.open());
  }
}

}  // namespace palpate::device
