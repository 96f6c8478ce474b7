// SPDX-License-Identifier: Apache-2.0
// Embree's device and what goes wrong with it.
#pragma once

#include "core/plugin/embree.h"

#include <memory>
#include <mutex>
#include <string>

namespace marram {

struct DeviceErrors { // the first one
    std::mutex lock;
    RTCError code = RTC_ERROR_NONE;
    std::string text;
};

// A device whose errors go to `errors`, which lives as long as it. Throws InputError, and std::bad_alloc.
std::shared_ptr<RTCDeviceTy> make_device(std::shared_ptr<DeviceErrors>& errors);

// As if nothing had been reported.
void forget(DeviceErrors& errors);

// Throws what was reported: InputError, or Cancelled.
void raise(DeviceErrors& errors);

} // namespace marram
