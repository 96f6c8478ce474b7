// SPDX-License-Identifier: Apache-2.0
// Embree's device, its errors and its memory.
#pragma once

#include "core/plugin/embree.h"

#include <atomic>
#include <limits>
#include <memory>
#include <mutex>
#include <string>

namespace marram {

// What Embree tells of a device.
struct DeviceState {
    // Only the first error.
    std::mutex lock;
    RTCError code = RTC_ERROR_NONE;
    std::string text;

    // Bytes of what it has allocated: buffers that it owns, BVHs, and what their builds need meanwhile.
    std::atomic<int64_t> bytes{0}, peak{0};
    // What goes beyond fails, and raise() says so.
    std::atomic<int64_t> limit{std::numeric_limits<int64_t>::max()};
};

// A device that reports to `state`, and keeps it alive. Throws InputError and std::bad_alloc.
std::shared_ptr<RTCDeviceTy> make_device(std::shared_ptr<DeviceState>& state);

// Clears the reported error; the peak and the limit are those of the next frame.
void reset(DeviceState& state);

// Throws the reported error, if any: InputError or Cancelled.
void raise(DeviceState& state);

} // namespace marram
