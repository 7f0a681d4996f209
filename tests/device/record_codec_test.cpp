// Ticks as bytes and back; files as they are, cut at every byte, with every byte changed.
#include "device/record/recording_header.h"

#include <cstdlib>

#include "tests/device/helpers.h"
#include "tests/device/record_rig.h"
#include "tests/files.h"

namespace palpate::device {
namespace {

constexpr std::uint64_t kSeed = 20260131;
/// Every byte of a file; under a sanitizer, which takes thirty times as long, every seventh: all eight bits
/// still.
#if defined(__has_feature)
constexpr std::size_t kByteStep = __has_feature(address_sanitizer) ? 7 : 1;
#else
constexpr std::size_t kByteStep = 1;
#endif

TEST(RecordCodec, ATickReadsBackToTheLastBit) {
  RandomTicks source(kSeed, RecordedTick::kMaxTracks);
  std::vector<std::byte> bytes(kMaxBytesATick);
  CallStorage calls{};
  for (int i = 0; i < 2000; ++i) {
    const Tick tick = source.next();
    RecordedTick given;
    given.t_ns = tick.t_ns;
    given.t_s = tick.t_s;
    given.state = tick.state;
    given.hip_mm = tick.state.position_mm;
    given.lost_before = i % 7 == 0 ? 12u : 0u;
    source.fill(tick, given);
    const std::size_t size = encode(given, bytes);
    ASSERT_LE(size, kMaxBytesATick);
    RecordedTick read;
    ByteReader from{std::span<const std::byte>(bytes).first(size)};
    ASSERT_TRUE(decode(from, {RecordedTick::kMaxTracks, 4}, calls, read)) << i;
    EXPECT_EQ(from.left(), 0u);
    ASSERT_EQ(difference(given, read), "") << "tick " << i << ", seed " << kSeed;
  }
}

TEST(RecordCodec, TheLongestTickHasItsBound) {
  RecordedTick tick;
  tick.t_s = 0.5;
  tick.hip_mm = tick.sent_n = Vec3{1.0, 2.0, 3.0};
  tick.state.raw.size = RawPacket::kMost;
  tick.lost_before = 1;
  tick.request = 1;
  tick.track_count = RecordedTick::kMaxTracks;
  std::array<RendererCall, kMaxCalls> calls{};
  for (RendererCall& call : calls) call = {RendererCall::Kind::kRestart, Vec3{1.0, 2.0, 3.0}, 1.0};
  for (RecordedTrack& track : tick.tracked()) {
    track.stepped = true;
    track.frame.force_n = Vec3{1.0, 0.0, 0.0};
    track.calls = calls;
  }
  std::vector<std::byte> bytes(kMaxBytesATick);
  EXPECT_EQ(encode(tick, bytes), kMaxBytesATick);
}

TEST(RecordCodec, WhatIsNoTickIsRefused) {
  RecordedTick tick;
  const RendererCall call{RendererCall::Kind::kStep, tick.hip_mm, tick.t_s};
  tick.tracks[0].stepped = true;
  tick.tracks[0].calls = std::span(&call, 1);
  std::vector<std::byte> bytes(kMaxBytesATick);
  bytes.resize(encode(tick, bytes));
  CallStorage calls{};
  RecordedTick read;
  const auto reads = [&](const std::vector<std::byte>& from, std::size_t renderers) {
    ByteReader reader{std::span<const std::byte>(from)};
    return decode(reader, {renderers, 1}, calls, read);
  };
  ASSERT_TRUE(reads(bytes, 1));
  EXPECT_FALSE(reads(bytes, 0)) << "its renderer is not in the table";
  for (std::size_t size = 0; size < bytes.size(); ++size)
    EXPECT_FALSE(reads({bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(size)}, 1)) << size;
  for (const std::size_t at : {std::size_t{0}, std::size_t{1}, std::size_t{3}}) {
    std::vector<std::byte> wrong = bytes;
    wrong[at] = std::byte{0xFF};
    EXPECT_FALSE(reads(wrong, 1)) << at;
  }
}

// What was found by fuzzing, and where fuzzing starts: an Error or ticks, never a crash. With
// PALPATE_WRITE_CORPUS set to the folder it writes the first of them again.
TEST(RecordCodec, TheCorpusIsReadOrRefused) {
  const std::filesystem::path folder = PALPATE_CORPUS;
  if (const char* const write_to = std::getenv("PALPATE_WRITE_CORPUS")) {
    MemoryDisk disk;
    RandomTicks source(kSeed);
    RecorderOptions options{.chunk_s = 0.004};
    ASSERT_TRUE(record(disk, source, 12, options));
    const auto write = [&](const char* name, const std::vector<std::byte>& bytes) {
      std::ofstream(std::filesystem::path(write_to) / name, std::ios::binary)
          .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    };
    write("whole.palrec", disk.bytes);
    write("torn.palrec", {disk.bytes.begin(), disk.bytes.end() - 100});
    write("header_alone.palrec", {disk.bytes.begin(), disk.bytes.begin() + kFileHeadBytes});
    std::vector<std::byte> damaged = disk.bytes;
    damaged[damaged.size() / 2] ^= std::byte{1};
    write("damaged.palrec", damaged);
  }
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    ++files;
    const std::string text = file_text(entry.path());
    const auto bytes = std::as_bytes(std::span<const char>(text));
    Result<Recording> recording = open_bytes({bytes.begin(), bytes.end()});
    const bool whole = entry.path().filename() == "whole.palrec";
    EXPECT_TRUE(recording || !whole);
    if (!recording) continue;
    RecordedTick tick;
    std::size_t ticks = 0;
    Result<bool> more = recording->next(tick);
    for (; more && *more; more = recording->next(tick)) ++ticks;
    if (whole) {
      EXPECT_EQ(ticks, 12u) << "a file of version 1 stays readable";
    }
  }
  EXPECT_GE(files, 4);
}

TEST(RecordCodec, AnAnswerWhoseCallsNobodyNotedIsKeptAndSaysSo) {
  RecordedTick tick, read;
  tick.tracks[0].stepped = true;
  tick.tracks[0].frame.force_n = Vec3{0.0, 0.0, 1.0};
  std::vector<std::byte> bytes(kMaxBytesATick);
  bytes.resize(encode(tick, bytes));
  CallStorage calls{};
  ByteReader from{std::span<const std::byte>(bytes)};
  ASSERT_TRUE(decode(from, {1, 1}, calls, read));
  EXPECT_TRUE(read.tracks[0].calls_lost);
  EXPECT_EQ(read.tracks[0].frame.force_n, tick.tracks[0].frame.force_n);
}

/// A short recording, whole.
class RecordFile : public testing::Test {
 protected:
  void SetUp() override {
    RecorderOptions options{.chunk_s = 0.004};
    ASSERT_TRUE(record(disk_, source_, static_cast<int>(kTicks), options));
  }
  /// Ticks read; an Error as text in `error`.
  std::size_t read(const std::vector<std::byte>& bytes, std::string& error, RecordingEnd* end = nullptr,
                   bool skip = false) {
    error.clear();
    ReadRecordingOptions options{.skip_damaged = skip};
    Result<Recording> recording = open_bytes(bytes, options);
    if (!recording) {
      error = recording.error().message();
      return 0;
    }
    RecordedTick tick;
    std::size_t ticks = 0;
    for (;;) {
      const Result<bool> more = recording->next(tick);
      if (!more) {
        error = more.error().message();
        return ticks;
      }
      if (!*more) break;
      if (!skip) {
        RecordedTick given = source_.given[ticks];
        given.dt_ns = tick.dt_ns;  // sums of the recorder
        given.late_ns = tick.late_ns;
        EXPECT_EQ(difference(given, tick), "") << ticks;
      }
      ++ticks;
    }
    if (end != nullptr) *end = recording->end();
    return ticks;
  }
  static constexpr std::size_t kTicks = 12;  // three chunks
  MemoryDisk disk_;
  RandomTicks source_{kSeed};
};

TEST_F(RecordFile, ReadsBackWhole) {
  std::string error;
  RecordingEnd end;
  EXPECT_EQ(read(disk_.bytes, error, &end), kTicks);
  EXPECT_EQ(error, "");
  EXPECT_TRUE(end.closed);
  EXPECT_EQ(end.reason, "ended");
  EXPECT_EQ(end.ticks, kTicks);
  EXPECT_EQ(end.lost, 0u);
  EXPECT_TRUE(end.warnings().empty());
  const auto recording = value_of(open_bytes(disk_.bytes));
  const RecordingHeader wanted = some_header(), &got = recording.header();
  EXPECT_EQ(got.program, wanted.program);
  EXPECT_EQ(got.scene_text, wanted.scene_text);
  EXPECT_EQ(got.scene_hash, wanted.scene_hash);
  EXPECT_EQ(got.device, wanted.device);
  EXPECT_EQ(got.limits.force_max_n, wanted.limits.force_max_n);
  EXPECT_EQ(got.limits.workspace_mm.high_mm, wanted.limits.workspace_mm.high_mm);
  EXPECT_EQ(got.world_from_device.translation_mm, wanted.world_from_device.translation_mm);
  EXPECT_EQ(got.decisions, wanted.decisions);
  EXPECT_EQ(got.clock_start_ns, wanted.clock_start_ns);
  EXPECT_EQ(got.started_utc, wanted.started_utc);
}

TEST_F(RecordFile, CutAtEveryByteItGivesWholeChunksAndSaysWhatItDropped) {
  std::size_t before = 0;
  for (std::size_t size = 0; size < disk_.bytes.size(); size += kByteStep) {
    std::string error;
    RecordingEnd end;
    const std::vector<std::byte> cut(disk_.bytes.begin(),
                                     disk_.bytes.begin() + static_cast<std::ptrdiff_t>(size));
    const std::size_t ticks = read(cut, error, &end);
    ASSERT_GE(ticks, before) << size;
    before = ticks;
    if (!error.empty()) {
      // Only where not even the header is whole.
      ASSERT_EQ(ticks, 0u);
      ASSERT_TRUE(error.find("nothing was recorded") != std::string::npos ||
                  error.find("is no recording") != std::string::npos)
          << size << ": " << error;
      continue;
    }
    EXPECT_FALSE(end.closed);
    EXPECT_FALSE(end.warnings().empty()) << size;
    EXPECT_EQ(end.torn_at + end.torn_bytes, end.torn_bytes > 0 ? size : 0u) << size;
  }
  EXPECT_EQ(before, kTicks);
}

TEST_F(RecordFile, AnyByteThatIsChangedIsNoticed) {
  for (std::size_t at = 0; at < disk_.bytes.size(); at += kByteStep) {
    std::vector<std::byte> wrong = disk_.bytes;
    wrong[at] ^= std::byte{static_cast<unsigned char>(1u << (at % 8))};
    std::string error;
    RecordingEnd end;
    read(wrong, error, &end);
    // In the last chunk it is a torn tail.
    ASSERT_TRUE(!error.empty() || !end.closed) << "byte " << at;
    if (!error.empty()) {
      EXPECT_TRUE(says(error, "memory.palrec"));
    }
  }
}

TEST_F(RecordFile, DamageInTheMiddleIsRefusedAndCanBeLeftOut) {
  std::vector<std::byte> wrong = disk_.bytes;
  wrong[wrong.size() / 2] ^= std::byte{4};
  std::string error;
  const std::size_t front = read(wrong, error);
  EXPECT_LT(front, kTicks);
  EXPECT_TRUE(says(error, "--skip-damaged", "byte "));
  RecordingEnd end;
  const std::size_t rest = read(wrong, error, &end, true);
  EXPECT_EQ(error, "");
  EXPECT_GT(rest, front);
  EXPECT_LT(rest, kTicks);
  ASSERT_EQ(end.damaged.size(), 1u);
  EXPECT_FALSE(end.warnings().empty());
}

TEST_F(RecordFile, ANewerVersionAndAnotherFileAreRefusedByName) {
  std::string error;
  std::vector<std::byte> wrong = disk_.bytes;
  wrong[8] = std::byte{9};
  read(wrong, error);
  EXPECT_TRUE(says(error, "version 9", "newer Palpate"));
  read(std::vector<std::byte>(64, std::byte{'x'}), error);
  EXPECT_TRUE(says(error, "is no recording"));
}

TEST_F(RecordFile, AFileMadeOfFalseHeadsCostsLittle) {
  // Heads whose own checksum is right and whose payload is not.
  ChunkHead head{ChunkKind::kTicks, 1, static_cast<std::uint32_t>(kMaxPayloadBytes), 1, 0, 1};
  const auto one = encode(head);
  std::vector<std::byte> wrong = disk_.bytes;
  for (std::size_t i = 0; i < 3 * kMaxPayloadBytes / one.size(); ++i)
    wrong.insert(wrong.end(), one.begin(), one.end());
  std::string error;
  RecordingEnd end;
  read(wrong, error, &end);
  EXPECT_TRUE(says(error, "damaged in more than"));
}

}  // namespace
}  // namespace palpate::device
