// SPDX-License-Identifier: Apache-2.0
// How the page of two pictures looks and what it does.
#pragma once

namespace marram::page {

extern const char* const style;  // a <style>
extern const char* const script; // a <script>, after all that it acts upon

} // namespace marram::page
