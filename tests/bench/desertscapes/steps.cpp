// SPDX-License-Identifier: Apache-2.0
// Prints what a step of the published code of "Desertscapes Simulation" takes, on its default scene of 256^2
// cells.
#include "desert.h"

#include <chrono>
#include <cstdio>

int main() {
    DuneSediment dune(Box2D(Vector2(0), Vector2(256)), 3.0, 5.0, Vector2(3, 0)); // as in its main.cpp
    const auto begin = std::chrono::steady_clock::now();
    for (int step = 0; step < 20; ++step) dune.SimulationStepMultiThreadAtomic();
    std::printf("%.2f\n",
                std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count() /
                    20);
}
