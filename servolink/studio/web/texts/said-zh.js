// Messages of the hub, the studio and the doctor in Simplified and in Traditional Chinese, by the English template in the
// module named above. The value of a name in braces is translated too.

/** @type {Record<string, [hans: string, hant: string]>} */
const MESSAGES = {
  // servolink/protocol/record_types.py
  "action": ["动作", "動作"],
  "macro": ["宏", "巨集"],
  "joystick table": ["按键表", "搖桿定義表"],
  // servolink/studio/page.py
  "studio: {who}": ["工作室：{who}", "studio：{who}"],
  "a page": ["一个页面", "某個頁面"],
  // servolink/hub/methods/context.py
  "the hub": ["hub", "hub"],
  "the hub, for raw angles": ["hub（原始角度）", "hub（原始角度）"],
  "the session has ended; connect again": ["会话已结束，请重新连接", "工作階段已結束，請重新連線"],
  // servolink/hub/rules/hub_gates.py
  "the servos of {name} are moved by {who}, which has had the lease for {time}: wait until it is free, or take it over with `servolink share --take {again}`": ["{name} 的舵机正由 {who} 控制（已 {time}）：请等待释放，或接管控制", "{name} 的舵機正由 {who} 操控（已 {time}）：請等對方交還控制權，或直接接手"],
  "the right to move the servos of {name} was taken from this program: `servolink share --give {again}` gives it back": ["此页面控制 {name} 舵机的权利已被收回，可用命令交还：servolink share --give {again}", "這個頁面操控 {name} 舵機的權利已被收回，可用指令交還：servolink share --give {again}"],
  "{packet} needs the role {needed}, and this program has the role {role}": ["{packet} 需要角色 {needed}，而此页面的角色是 {role}", "{packet} 需要角色 {needed}，而這個頁面的角色是 {role}"],
  "the time by which it was to begin has passed": ["已错过开始的时间", "已錯過應開始的時間"],
  // servolink/hub/doors/direct.py
  "nothing was moved: {reason}": ["没有移动：{reason}", "沒有移動：{reason}"],
  "{who} has exclusive use of the board": ["{who} 正在独占主板", "{who} 正在獨佔控制板"],
  "nothing was moved: {who} has taken exclusive use of the board": ["没有移动：{who} 正在独占主板", "沒有移動：{who} 正在獨佔控制板"],
  // servolink/hub/methods/prepared.py
  "nothing was moved: another program has exclusive use": ["没有移动：其他程序正在独占主板", "沒有移動：其他程式正在獨佔控制板"],
  "nothing was moved: the board was stopped since this was prepared": ["没有移动：准备之后主板被停止了", "沒有移動：準備好之後控制板被停止了"],
  "nothing was moved: the board was connected again since this was prepared": ["没有移动：准备之后主板重新连接了", "沒有移動：準備好之後控制板重新連線了"],
  // servolink/hub/methods/stored.py
  "a record is being changed": ["正在修改一条记录", "正在變更一筆紀錄"],
  "a project is being compared": ["正在比较项目", "正在比較專案"],
  "a project is being written": ["正在写入项目", "正在寫入專案"],
  "a backup is being restored": ["正在恢复备份", "正在還原備份"],
  "the board has no {kind} {id} any more": ["主板上已没有 {kind} {id}", "控制板上已經沒有 {kind} {id}"],
  "the board holds an unfinished import: apply the project again, or roll back": ["主板上有未完成的写入：请重新写入项目，或回滚", "控制板上有未完成的寫入：請重新寫入專案，或還原"],
  "there is no backup {number}; project.backups lists them": ["没有备份 {number}", "沒有備份 {number}"],
  // servolink/hub/methods/methods.py
  "the transmission mode is being set": ["正在设置传输模式", "正在設定傳輸模式"],
  // servolink/hub/engine/stop_order.py
  "a stop was sent {count} times and could not be confirmed": ["停止命令已发送 {count} 次，但无法确认", "停止指令已傳送 {count} 次，但無法確認"],
  "servos {ids} were asked to stop, and do not report that they are stopped": ["已要求舵机 {ids} 停止，但它们没有报告已停止", "已要求舵機 {ids} 停止，但它們沒有回報已停止"],
  // servolink/hub/engine/hub_recorder.py
  "{file} is being recorded already": ["已经在记录 {file}", "已經在錄製 {file}"],
  "nothing is being recorded": ["没有正在进行的记录", "沒有正在進行的錄製"],
  "cannot record: {reason}": ["无法记录：{reason}", "無法錄製：{reason}"],
  "the disk has only {free} MiB left": ["磁盘只剩 {free} MiB", "磁碟只剩 {free} MiB"],
  // servolink/motion/ticket.py
  "a stop came first": ["已先被停止", "已先被停止"],
  // servolink/motion/movement.py
  "servo {id}: {angle} degrees is outside its limits {limits}": ["舵机 {id}：{angle} 度超出限位 {limits}", "舵機 {id}：{angle} 度超出角度限制 {limits}"],
  "servo {id}: {distance} degrees in {time} s is {speed} degrees/s; its cap is {cap}": ["舵机 {id}：{time} 秒转 {distance} 度即 {speed} 度/秒，上限为 {cap}", "舵機 {id}：{time} 秒轉動 {distance} 度等於每秒 {speed} 度，上限是 {cap}"],
  "servo {id}: limits and speeds are in degrees, and this servo is not set to degrees": ["舵机 {id}：限位和速度以度为单位，而此舵机没有设为度", "舵機 {id}：限制與速度以度為單位，而這顆舵機沒有設為度（Degree）"],
  // servolink/motion/set_points.py
  "the board has no servo {id}": ["主板没有舵机 {id}", "控制板沒有舵機 {id}"],
  // servolink/transports/lifecycle.py
  "{url}: cannot open it: {reason}": ["{url}：无法打开：{reason}", "{url}：無法開啟：{reason}"],
  "{url}: the connection was lost: {reason}": ["{url}：连接断开：{reason}", "{url}：連線中斷：{reason}"],
  "{url}: it was closed while being opened; try again": ["{url}：打开时被关闭，请重试", "{url}：開啟時被關閉，請再試一次"],
  // servolink/transports/serial.py
  "{url}: {reason}": ["{url}：{reason}", "{url}：{reason}"],
  "there is no {device}; plug the board in and switch it on; {present}": ["没有 {device}，请接上主板并打开电源；{present}", "沒有 {device}，請接上控制板並打開電源；{present}"],
  "{device} is in use; close the program that has it (another servolink, a serial monitor, ModemManager)": ["{device} 已被占用，请关闭占用它的程序（其他 servolink、串口监视器、ModemManager）", "{device} 使用中，請關閉佔用它的程式（其他 servolink、序列埠監控視窗、ModemManager）"],
  "no permission for {device}; on Linux join its group, `sudo usermod -aG dialout $USER` (uucp on Arch), then log out and in": ["没有 {device} 的权限；在 Linux 上请加入它的用户组：`sudo usermod -aG dialout $USER`（Arch 为 uucp），然后注销并重新登录", "沒有 {device} 的權限；在 Linux 上請加入它的群組：`sudo usermod -aG dialout $USER`（Arch 是 uucp），然後登出再登入"],
  "{device} is not a serial port; {present}": ["{device} 不是串口；{present}", "{device} 不是序列埠；{present}"],
  "cannot open {device}: {reason}": ["无法打开 {device}：{reason}", "無法開啟 {device}：{reason}"],
  "the device is gone; is it unplugged or switched off?": ["设备已消失：是否被拔下或关闭？", "裝置已消失：是否被拔掉或關閉電源？"],
  "no serial port is here": ["这里没有串口", "這裡沒有序列埠"],
  "the serial ports here: {ports}": ["这里的串口：{ports}", "這裡的序列埠：{ports}"],
  // servolink/transports/serial_ports.py
  "no permission for {device}; `servolink doctor` says how to get it": ["没有 {device} 的权限，处理方法见下", "沒有 {device} 的權限，處理方式如下"],
  // servolink/transports/stream.py
  "no answer within {time} s; check address, network and firewall, or give timeout=SECONDS": ["{time} 秒内没有应答；请检查地址、网络和防火墙", "{time} 秒內沒有回應；請檢查位址、網路與防火牆"],
  "nothing listens on port {port} of {host}; start the bridge or virtual board, or check the port": ["{host} 的端口 {port} 没有程序在监听；请启动网桥或虚拟主板，或检查端口", "{host} 的連接埠 {port} 沒有程式在接聽；請啟動橋接程式或虛擬控制板，或檢查連接埠號碼"],
  "there is no host '{host}'; check the name, or write its IP address": ["没有名为“{host}”的主机；请检查名称，或填写 IP 地址", "沒有名為「{host}」的主機；請檢查名稱，或改填 IP 位址"],
  "cannot connect: {reason}; check address and network": ["无法连接：{reason}；请检查地址和网络", "無法連線：{reason}；請檢查位址與網路"],
  "the other side closed the connection": ["对方关闭了连接", "對方關閉了連線"],
  // servolink/control/channel.py
  "the hub of {name} has not answered {method} within {time} s": ["{name} 的 hub 在 {time} 秒内没有应答 {method}", "{name} 的 hub 在 {time} 秒內沒有回應 {method}"],
  // servolink/studio/robots.py
  "{name} is in exclusive use by {who} ({reason}); change the robot when that is done": ["{who} 正在独占 {name}（{reason}），完成后再更换机器人", "{who} 正在獨佔 {name}（{reason}），完成後再更換機器人"],
  // servolink/studio/studio_methods.py
  "the studio does not use this board any more": ["工作室已不再使用此主板", "studio 已不再使用這塊控制板"],
  "this page was opened through a link": ["此页面是通过链接打开的", "這個頁面是透過連結開啟的"],
  "use the page on the machine of the studio": ["请使用运行工作室的电脑上的页面", "請改用執行 studio 的電腦上的頁面"],
  // servolink/studio/limit_methods.py
  "the lowest angle is above the highest angle": ["最小角度大于最大角度", "最小角度大於最大角度"],
  "exchange the angles": ["请对调两个角度", "請對調兩個角度"],
  "limits are kept by the name of a board, and this board has no name": ["限位按主板名称保存，而此主板没有名称", "角度限制依控制板的名稱保存，而這塊控制板沒有名稱"],
  // servolink/studio/project_methods.py
  "there is no backup {number}; look at the list of backups again": ["没有备份 {number}，请重新查看备份列表", "沒有備份 {number}，請重新查看備份清單"],
  // servolink/studio/recording_methods.py
  "the recording cannot be read: {reason}": ["无法读取记录文件：{reason}", "無法讀取錄製檔：{reason}"],
  // servolink/studio/kept.py
  "the {kind} of a board cannot be kept: {reason}": ["无法保存主板的 {kind}：{reason}", "無法儲存控制板的 {kind}：{reason}"],
  // servolink/project/validate.py
  "the project takes {size} bytes; the board has {memory}": ["项目需要 {size} 字节，主板有 {memory}", "專案需要 {size} 位元組，控制板有 {memory}"],
  "button {id} starts no macro": ["按键 {id} 不启动任何宏", "按鈕 {id} 不會啟動任何巨集"],
  "there is no {kind} {id}": ["没有 {kind} {id}", "沒有 {kind} {id}"],
  "there is no servo {id}": ["没有舵机 {id}", "沒有舵機 {id}"],
  "there is no joystick table {id}": ["没有按键表 {id}", "沒有搖桿定義表 {id}"],
  // servolink/doctor/environment.py
  "ModemManager is running, and nothing keeps it away from {device}": ["ModemManager 正在运行，没有规则让它避开 {device}", "ModemManager 正在執行，沒有規則讓它避開 {device}"],
  "or, if you have no modem: sudo systemctl disable --now ModemManager": ["如果没有调制解调器：sudo systemctl disable --now ModemManager", "如果沒有數據機：sudo systemctl disable --now ModemManager"],
  "a {chip} adapter ({vendor}:{product}) is plugged in and has no serial port, and brltty is installed": ["已插入 {chip} 转接器（{vendor}:{product}），但没有串口，而系统装有 brltty", "已插上 {chip} 轉接器（{vendor}:{product}），但沒有序列埠，而系統裝有 brltty"],
  "if you have no Braille display: sudo apt remove brltty": ["如果没有盲文显示器：sudo apt remove brltty", "如果沒有點字顯示器：sudo apt remove brltty"],
  "if you have a Braille display: sudo ln -s /dev/null /etc/udev/rules.d/{name}": ["如果有盲文显示器：sudo ln -s /dev/null /etc/udev/rules.d/{name}", "如果有點字顯示器：sudo ln -s /dev/null /etc/udev/rules.d/{name}"],
  "unplug the board and plug it in again": ["拔下主板再重新插上", "拔掉控制板再重新插上"],
  "to see its programs: servolink share --status": ["查看使用它的程序：servolink share --status", "查看使用它的程式：servolink share --status"],
  "process {pid} ({name}) has {path} open": ["进程 {pid}（{name}）打开了 {path}", "行程 {pid}（{name}）開啟了 {path}"],
  "close the program, or: kill {pid}": ["关闭该程序，或：kill {pid}", "關閉那個程式，或：kill {pid}"],
  "{path} is {time} ms": ["{path} 为 {time} ms", "{path} 是 {time} ms"],
  "{count} of {total} responses took {low} to {high} ms": ["{total} 个应答中有 {count} 个用时 {low} 到 {high} ms", "{total} 個回應中有 {count} 個費時 {low} 到 {high} ms"],
  "set the latency timer of the adapter to 1 ms on the computer with the adapter": ["在连接转接器的电脑上把延迟定时器设为 1 ms", "在連接轉接器的電腦上，將延遲計時器設為 1 ms"],
  "Device Manager, Ports, {name}, Properties, Port Settings, Advanced: Latency Timer 1 ms": ["设备管理器 > 端口 > {name} > 属性 > 端口设置 > 高级：延迟定时器 1 ms", "裝置管理員 > 連接埠 > {name} > 內容 > 連接埠設定 > 進階：延遲計時器 1 ms"],
  "until it is unplugged: echo 1 | sudo tee /sys/bus/usb-serial/devices/{name}/latency_timer": ["到拔下为止：echo 1 | sudo tee /sys/bus/usb-serial/devices/{name}/latency_timer", "到拔掉為止：echo 1 | sudo tee /sys/bus/usb-serial/devices/{name}/latency_timer"],
  "for good: install the rule printed by `servolink doctor --print-udev`": ["永久：安装 `servolink doctor --print-udev` 输出的规则", "永久：安裝 `servolink doctor --print-udev` 印出的規則"],
  "`import hid` finds {path}": ["`import hid` 找到的是 {path}", "`import hid` 找到的是 {path}"],
  "Python finds no module hid": ["Python 找不到模块 hid", "Python 找不到模組 hid"],
  "pyusb finds no libusb": ["pyusb 找不到 libusb", "pyusb 找不到 libusb"],
  "Python finds no module usb": ["Python 找不到模块 usb", "Python 找不到模組 usb"],
  "the system is Linux inside Windows (WSL)": ["系统是 Windows 中的 Linux（WSL）", "系統是 Windows 裡的 Linux（WSL）"],
  "in PowerShell as administrator: usbipd list": ["在管理员 PowerShell 中：usbipd list", "在系統管理員的 PowerShell 中：usbipd list"],
  "servolink runs in a container ({name})": ["servolink 运行在容器中（{name}）", "servolink 在容器中執行（{name}）"],
  "for HID and USB: --device=/dev/hidraw0, --device=/dev/bus/usb": ["HID 和 USB：--device=/dev/hidraw0、--device=/dev/bus/usb", "HID 與 USB：--device=/dev/hidraw0、--device=/dev/bus/usb"],
  "this Python is packaged as {kind}": ["这个 Python 的打包方式是 {kind}", "這個 Python 的封裝方式是 {kind}"],
  "run servolink with the system's Python, in a virtual environment: python3 -m venv": ["用系统的 Python 在虚拟环境中运行 servolink：python3 -m venv", "用系統的 Python 在虛擬環境中執行 servolink：python3 -m venv"],
  "the address names {device}": ["地址写的是 {device}", "位址寫的是 {device}"],
  "use the other port: --board serial://{device}": ["改用另一个端口：--board serial://{device}", "改用另一個連接埠：--board serial://{device}"],
  // servolink/doctor/permissions.py
  "{path} belongs to {owner}:{group} with mode {mode}; {user} is in {groups}": ["{path} 属于 {owner}:{group}，模式 {mode}；{user} 所在的组：{groups}", "{path} 屬於 {owner}:{group}，模式 {mode}；{user} 所在的群組：{groups}"],
  "log out and in again, or for this terminal: newgrp {group}": ["注销并重新登录，或仅在此终端中：newgrp {group}", "登出再登入，或只在這個終端機中：newgrp {group}"],
  "log out and in again": ["注销并重新登录", "登出再登入"],
  "a service instead: SupplementaryGroups={group} in the unit": ["如果是服务：在 unit 中加入 SupplementaryGroups={group}", "如果是服務：在 unit 中加入 SupplementaryGroups={group}"],
  "run as the owner, or ask the owner: chmod g+rw {path}": ["以所有者身份运行，或请所有者执行：chmod g+rw {path}", "以擁有者身分執行，或請擁有者執行：chmod g+rw {path}"],
  "{path} tags this board with uaccess": ["{path} 给此主板加了 uaccess 标签", "{path} 為這塊控制板加上了 uaccess 標籤"],
};

/** @param {0 | 1} at */
const templates = (at) => Object.entries(MESSAGES).map(([english, both]) => ({ english, translation: both[at] }));

/** Templates of messages by language. */
export const TEMPLATES = { "zh-Hans": templates(0), "zh-Hant": templates(1) };
